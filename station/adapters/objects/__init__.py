"""Raw frames of a plant as objects by their SHA-256: a folder, or whatever `fsspec` reaches (S3, GCS, Azure)."""
