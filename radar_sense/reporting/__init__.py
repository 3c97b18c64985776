"""The report: one HTML file with the answers of several analyses, their figures and warnings."""
