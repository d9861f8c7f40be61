"""Every type of error that pydantic knows → a message id, and which of its context the sentence names.

A test compares this table with pydantic's own list, so that none of its internal sentences reaches a person.
"""

from collections.abc import Mapping

#: Message id, and the message's parameter → key of pydantic's context.
Entry = tuple[str, Mapping[str, str]]

#: What a schema of ours cannot cause, and a later pydantic's new types.
UNEXPECTED: Entry = "value-not-usable", {}

_BARE = {
    "value-missing": (
        "missing missing_argument missing_keyword_only_argument missing_positional_only_argument missing_sentinel_error"
    ),
    "value-not-block": (
        "model_type model_attributes_type dataclass_type dataclass_exact_type dict_type frozen_dict_type "
        "ordered_dict_type counter_type mapping_type arguments_type"
    ),
    "value-not-list": (
        "list_type tuple_type set_type frozen_set_type deque_type iterable_type iteration_error named_tuple_type"
    ),
    "value-not-text": "string_type string_sub_type bytes_type invalid_key json_type",
    "value-not-unicode": "string_unicode bytes_invalid_encoding",
    "value-not-ascii": "string_not_ascii",
    "value-not-whole": "int_type int_parsing int_from_float",
    "value-too-many-digits": "int_parsing_size",
    "value-not-number": (
        "float_type float_parsing decimal_type decimal_parsing fraction_type fraction_parsing complex_type "
        "complex_str_parsing"
    ),
    "value-not-finite": "finite_number",
    "value-not-switch": "bool_type bool_parsing",
    "value-not-empty": "none_required",
    "value-not-json": "json_invalid",
    "value-not-date": "date_type date_parsing date_from_datetime_parsing date_from_datetime_inexact",
    "value-not-time": "time_type time_parsing",
    "value-not-instant": "datetime_type datetime_parsing datetime_object_invalid datetime_from_date_parsing",
    "value-not-past": "date_past datetime_past",
    "value-not-future": "date_future datetime_future",
    "value-with-zone": "timezone_naive",
    "value-without-zone": "timezone_aware timezone_offset",
    "value-not-duration": "time_delta_type time_delta_parsing",
    "value-not-address": "url_type url_parsing url_syntax_violation",
    "value-not-uuid": "uuid_type uuid_parsing uuid_version",
    "value-nested-too-deep": "recursion_loop recursion_depth_exceeded",
}
_WITH_CONTEXT: Mapping[str, Entry] = {
    "greater_than": ("value-not-above", {"limit": "gt"}),
    "greater_than_equal": ("value-below", {"limit": "ge"}),
    "less_than": ("value-not-under", {"limit": "lt"}),
    "less_than_equal": ("value-above", {"limit": "le"}),
    "multiple_of": ("value-not-multiple", {"step": "multiple_of"}),
    "string_too_short": ("value-text-too-short", {"limit": "min_length"}),
    "bytes_too_short": ("value-text-too-short", {"limit": "min_length"}),
    "string_too_long": ("value-text-too-long", {"limit": "max_length"}),
    "bytes_too_long": ("value-text-too-long", {"limit": "max_length"}),
    "url_too_long": ("value-text-too-long", {"limit": "max_length"}),
    "string_pattern_mismatch": ("value-pattern", {"pattern": "pattern"}),
    "enum": ("value-none-of", {"choices": "expected"}),
    "literal_error": ("value-none-of", {"choices": "expected"}),
    "union_tag_invalid": ("value-none-of", {"choices": "expected_tags"}),
    "url_scheme": ("value-none-of", {"choices": "expected_schemes"}),
    "union_tag_not_found": ("value-without-kind", {"key": "discriminator"}),
    "decimal_max_digits": ("value-too-precise", {"limit": "max_digits"}),
    "decimal_max_places": ("value-too-precise", {"limit": "decimal_places"}),
    "decimal_whole_digits": ("value-too-precise", {"limit": "whole_digits"}),
    "too_short": ("value-too-few", {"limit": "min_length", "count": "actual_length"}),
    "too_long": ("value-too-many", {"limit": "max_length", "count": "actual_length"}),
}
_OF_CODE = (
    "no_such_attribute needs_python_object frozen_field frozen_instance get_attribute_error default_factory_not_called "
    "set_item_not_hashable is_instance_of is_subclass_of callable_type ellipsis_error unexpected_keyword_argument "
    "unexpected_positional_argument multiple_argument_values"
)

TYPES: Mapping[str, Entry] = {
    **{kind: (id_, {}) for id_, kinds in _BARE.items() for kind in kinds.split()},
    **_WITH_CONTEXT,
    **dict.fromkeys(_OF_CODE.split(), UNEXPECTED),
}
