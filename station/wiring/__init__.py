"""Settings → a station: the only place that picks adapters. One file for each thing that is picked."""
