"""Figures, pages and interactive views of models."""
