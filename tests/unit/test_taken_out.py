"""Which unit was taken out of a nest: whatever a person does, no unit is taken for another nest's."""

from hypothesis import given
from hypothesis import strategies as st

from station.domain.product.taken_out import unit_left_over, unit_taken_out

UNITS = st.frozensets(st.integers(1, 16), max_size=16)


@given(silent=UNITS, proven=UNITS)
def test_a_unit_is_named_only_where_it_alone_is_silent(silent: frozenset[int], proven: frozenset[int]) -> None:
    unit = unit_taken_out(silent, proven)
    assert (unit is not None) == (len(silent) == 1 and silent.isdisjoint(proven))
    assert unit is None or unit in silent


@given(order=st.permutations(range(1, 9)), acts=st.data())
def test_every_nest_gets_its_own_unit_whatever_is_silent_at_first(order: list[int], acts: st.DataObject) -> None:
    units, proven = frozenset(order), dict[int, int]()
    for nest, own in enumerate(order):
        left = unit_left_over(units, frozenset(proven.values()))
        if left is not None:
            assert nest == len(order) - 1
            proven[nest] = left
            break
        with_others = acts.draw(st.frozensets(st.sampled_from(order), max_size=3)) | {own}
        found = unit_taken_out(with_others, frozenset(proven.values()))
        proven[nest] = found if found is not None else unit_taken_out({own}, frozenset(proven.values())) or 0
    assert list(proven.values()) == order


@given(units=UNITS, proven=UNITS)
def test_the_last_unit_needs_no_proof_only_where_it_is_the_last(units: frozenset[int], proven: frozenset[int]) -> None:
    left = unit_left_over(units, proven)
    assert (left is not None) == (len(units - proven) == 1)
    assert left is None or left in units - proven
