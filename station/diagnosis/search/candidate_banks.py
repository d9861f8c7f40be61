"""Every cause and kernel that some visits could show, made anew only where the simulation has changed."""

from collections.abc import Collection
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from station.diagnosis.candidates import kernels as generic
from station.diagnosis.candidates.bank import (
    Bank,
    Candidate,
    build_bank,
    candidates,
    cause_library,
    is_testable,
)
from station.diagnosis.candidates.free_visits import says_nothing
from station.diagnosis.candidates.law_families import LawFamily
from station.diagnosis.data.residuals import ResidualView
from station.diagnosis.search.narrow_laws import laws_to_find
from station.model.effects.disturbed_visit import DisturbedVisit

#: Where two simulations differ by less than this share of the stimulus a cause looks alike in both, but for that share.
SAME_SIGNATURE_SHARE = 1e-3


class CandidateBanks:
    """The candidates of some visits. Their signatures are those of another view where that simulates nearly the
    same."""

    def __init__(self, view: ResidualView) -> None:
        self._view, self._candidates = view, all_candidates(view)
        self._still: tuple[Bank, Collection[str]] | None = None
        self._laws: tuple[ResidualView, tuple[LawFamily, ...]] | None = None

    def of(self, view: ResidualView, hidden: Collection[str]) -> tuple[Bank, Bank]:
        """The still and the moving candidates in a view, without the causes that are hidden from these data."""
        if not view.simulates_nearly(self._view, SAME_SIGNATURE_SHARE):
            self._view, self._candidates, self._still = view, all_candidates(view), None
        chosen = [c for c in self._candidates if c.name not in hidden]
        if self._still is None or self._still[1] != hidden:
            self._still = build_bank(chosen, view.layout, moving=False), hidden
        still = self._still[0]
        if still.all_columns is not None:
            # Columns that are laid out are those of this view alone.
            self._still = None
        return still, build_bank(chosen, view.layout, moving=True)

    def of_laws(self, view: ResidualView) -> tuple[LawFamily, ...]:
        """The single laws of a view, made when they are first asked for."""
        if self._laws is None or not view.simulates_nearly(self._laws[0], SAME_SIGNATURE_SHARE):
            self._laws = view, laws_to_find(view)
        return self._laws[1]


def all_candidates(view: ResidualView) -> tuple[Candidate, ...]:
    """Every cause and kernel that these data could show."""
    effects = [e for e in cause_library(view.scene.recipe) if is_testable(e, view)]
    if view.grid.k == 1:
        # A turn shows in no length: what a disturbed visit is longer or shorter by is among the readings below.
        effects = [e for e in effects if e.id != DisturbedVisit.id]
    items = [c for e in effects for c in candidates(e, view)]
    items = [*items, *generic.kernel_candidates(view), *generic.disturbed_readings(view)]
    # Levels that group alike have one code: of a fleet's hundreds, and each as long as its visits.
    codes = dict[bytes, NDArray[np.int32]]()
    return tuple(_with_one_code(c, codes) for c in items if not says_nothing(c, view))


def _with_one_code(c: Candidate, codes: dict[bytes, NDArray[np.int32]]) -> Candidate:
    """The candidate with the code of those before it that group alike."""
    code = codes.setdefault(c.code.tobytes(), c.code)
    return c if code is c.code else replace(c, code=code)
