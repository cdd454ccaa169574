"""Figures on rows that the fit has not seen."""
