"""Pictures of models, for eyes and papers."""
