"""What the shapes of a population have in common: corresponding points, mean, modes, and a prior made of them."""
