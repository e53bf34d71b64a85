"""What a cardiologist reads off a model: volumes, ejection fraction, wall, strain, twist, segments."""
