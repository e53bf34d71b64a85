"""quadriform."""
