"""Drawing tools of the experiments: the look of figures, SVG and PDF files, tables."""
