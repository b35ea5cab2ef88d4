"""The palpation model: compliance of each press and its derivatives by the modulus."""
