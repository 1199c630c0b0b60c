"""Labels of distances are read back option by option."""

from __future__ import annotations

import pytest

from gdg.contact_maps import CHANGED_OPTION


@pytest.mark.parametrize(
    ("label", "options"),
    [
        ("release", {}),
        ("release-gamma0.5", {"gamma": "0.5"}),
        ("v1-knee0.005-reach1e-05-gamma2", {"knee": "0.005", "reach": "1e-05", "gamma": "2"}),
        ("v1-far_reach1e+06-knee3", {"far_reach": "1e+06", "knee": "3"}),
    ],
)
def test_every_option_of_a_label_is_read(label: str, options: dict[str, str]):
    assert dict(CHANGED_OPTION.findall(label)) == options
    assert CHANGED_OPTION.sub("", label) == label.partition("-")[0]
