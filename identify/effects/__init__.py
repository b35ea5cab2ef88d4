"""What an effect is: its base class, its parameters, the readings that it acts on."""
