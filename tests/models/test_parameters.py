"""A model: its numbers by name."""

from __future__ import annotations

import pytest
from hypothesis import given, settings
from random_models import models

from whiptool.errors import InputError


@given(models())
@settings(max_examples=50, deadline=None, derandomize=True)
def test_every_parameter_can_be_changed_by_name(model):
    for name, value in model.parameters().items():
        changed = model.with_parameters({name: value + 0.5})
        assert changed != model
        assert changed.parameters()[name] == pytest.approx(value + 0.5)
        assert changed.with_parameters({name: value}) == model
    with pytest.raises(InputError, match=r"whip\.l"):
        model.with_parameters({"whip.q": 1.0})
