"""What the command line and the page both show, as values and as text: figures, reports, documents. Pure."""
