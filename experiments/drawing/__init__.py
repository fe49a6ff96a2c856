"""What experiments draw with: the look of figures, SVG and PDF, tables."""
