"""How this process deals with memory that it frees."""

from station.adapters.malloc_tuning import release_free_memory, retain_all_memory, retain_freed_memory

__all__ = ["release_free_memory", "retain_all_memory", "retain_freed_memory"]
