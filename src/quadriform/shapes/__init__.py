"""What a model is: pure geometry, no fitting, no files (paper 2, 3.1, appendices A and B)."""
