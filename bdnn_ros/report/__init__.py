"""Reports: a diagnosis as one self-contained HTML page, and figures as PNG."""
