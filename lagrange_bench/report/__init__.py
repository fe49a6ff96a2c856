"""The report: reads stored rows, writes one page, figures and tables."""
