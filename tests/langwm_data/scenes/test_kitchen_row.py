"""A row of kitchen units that is too long for its wall, as units of catalogues differ in width."""

import pytest

from langwm_data.scenes.furnishing.kitchen import _shorten
from langwm_data.scenes.furniture import build_model

CABINET, SINK, STOVE = (build_model(f"{name}_01") for name in ("kitchen_cabinet", "kitchen_sink", "stove"))


@pytest.mark.parametrize(("num_units", "left"), [(4.0, 4), (3.9, 3), (2.0, 2), (0.5, 2)])
def test_cupboards_are_left_out_until_the_row_fits(num_units, left):
    row = [SINK, CABINET, CABINET, STOVE]
    taken = _shorten(row, num_units * CABINET.size[0])
    assert len(row) == left
    assert {SINK.category, STOVE.category} <= {m.category for m in row}
    assert [m.category for m in taken] == ["kitchen_cabinet"] * (4 - left)
