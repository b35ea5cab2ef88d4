"""The catalogue of physical effects that a palpation model may lack, one file an effect."""
