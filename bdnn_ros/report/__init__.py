"""Reports: a diagnosis as a self-contained HTML page, and figures as PNG."""
