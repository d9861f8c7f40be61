"""Tables of samples one after the other as one."""

from collections.abc import Sequence

import numpy as np

from station.domain.core.types import Labels, SampleTable


def join(parts: Sequence[SampleTable]) -> SampleTable:
    """One table of several; columns that not all of them have are left out."""
    if len(parts) == 1:
        return parts[0]
    labels = [name for name in parts[0].labels if all(name in p.labels for p in parts)]
    values = [name for name in parts[0].values if all(name in p.values for p in parts)]
    gold = [p.gold for p in parts if p.gold is not None]
    return SampleTable(
        unit=_join_labels([p.unit for p in parts]),
        run=np.concatenate([p.run for p in parts]),
        visit=np.concatenate([p.visit for p in parts]),
        position=_join_labels([p.position for p in parts]),
        time_s=np.concatenate([p.time_s for p in parts]),
        reading=np.concatenate([p.reading for p in parts]),
        labels={k: _join_labels([p.labels[k] for p in parts]) for k in labels},
        values={k: np.concatenate([p.values[k] for p in parts]) for k in values},
        gold=np.concatenate(gold) if len(gold) == len(parts) else None,
    )


def _join_labels(parts: Sequence[Labels]) -> Labels:
    """Names in the order in which they come."""
    names = {name: i for i, name in enumerate(dict.fromkeys(n for p in parts for n in p.names))}
    codes = [np.array([names[n] for n in p.names], np.int32)[p.code] for p in parts]
    return Labels(tuple(names), np.concatenate(codes))
