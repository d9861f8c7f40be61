"""The report: a diagnosis as one page that a person understands at the first screen. Values in, text out."""
