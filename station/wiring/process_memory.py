"""How this process deals with memory that it frees."""

from station.adapters.malloc_tuning import retain_all_memory, retain_freed_memory

__all__ = ["retain_all_memory", "retain_freed_memory"]
