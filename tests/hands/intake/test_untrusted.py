"""Whatever is damaged in a description, it is taken in or refused in words; nothing crashes."""

from __future__ import annotations

import contextlib
import re
from pathlib import Path

import pytest
from descriptions import LIMIT, box, finger, write
from hypothesis import given
from hypothesis import strategies as st

from gdg.errors import GdgError
from gdg.hands.intake import take_in

CAPSULE = '<collision><geometry><capsule radius="0.01" length="0.04"/></geometry></collision>'
URDF = finger(
    LIMIT + '<mimic joint="j1" multiplier="2" offset="0.1"/>', box() + box("visual") + CAPSULE
).replace("</robot>", '<transmission><joint name="j1"/></transmission></robot>')
GEOM = '<geom type="box" size="0.01 0.01 0.02"/>'
MJCF = f"""
<mujoco><compiler angle="radian"/>
<worldbody><body name="palm">{GEOM}
  <body name="b" pos="0 0 0.04"><joint name="j" axis="0 1 0" range="0 1"/>{GEOM}
    <body name="c" pos="0.04 0 0"><joint name="k" axis="0 1 0" range="-2 2"/>{GEOM}</body></body>
  <body name="d" pos="0.04 0 0"><joint name="l" axis="0 1 0" range="-2 2" ref="0"/>{GEOM}</body>
</body></worldbody>
<tendon><fixed name="t"><joint joint="j" coef="1"/></fixed></tendon>
<equality><connect body1="c" body2="d" anchor="0 0 0"/></equality>
<actuator><position tendon="t" kp="2" forcerange="-1 1"/></actuator>
<contact><exclude body1="palm" body2="c"/></contact>
</mujoco>"""
ODD = (
    "", " ", "nan", "inf", "-1", "0", "1e300", "-1e-300", "1 2 3", "0.1", "99999999999", "true",
    "palm", "j", "é",
)  # fmt: skip


@pytest.mark.filterwarnings("ignore::RuntimeWarning")
@pytest.mark.parametrize("text", [URDF, MJCF], ids=["urdf", "mjcf"])
@given(data=st.data())
def test_odd_values_are_taken_in_or_refused(
    tmp_path_factory: pytest.TempPathFactory, text: str, data: st.DataObject
):
    for _ in range(data.draw(st.integers(0, 2))):
        places = list(re.finditer(r'="([^"]*)"', text))
        place = data.draw(st.sampled_from(places))
        text = text[: place.start(1)] + data.draw(st.sampled_from(ODD)) + text[place.end(1) :]
    accept_or_refuse(tmp_path_factory.getbasetemp(), text)


@pytest.mark.parametrize("text", [URDF, MJCF], ids=["urdf", "mjcf"])
@given(data=st.data())
def test_damaged_files_are_taken_in_or_refused(
    tmp_path_factory: pytest.TempPathFactory, text: str, data: st.DataObject
):
    damaged = bytearray(text.encode())
    for _ in range(data.draw(st.integers(1, 4))):
        at = data.draw(st.integers(0, len(damaged) - 1))
        damaged[at : at + data.draw(st.integers(0, 30))] = data.draw(st.binary(max_size=3))
    accept_or_refuse(tmp_path_factory.getbasetemp(), bytes(damaged))


@pytest.mark.parametrize("text", [URDF, MJCF], ids=["urdf", "mjcf"])
def test_the_undamaged_files_are_taken_in(tmp_path: Path, text: str):
    accepted = take_in(write(tmp_path, text), tmp_path / "new", "acme")
    assert accepted.actuated is not None


@pytest.mark.parametrize("tag", ["robot", "mujoco"])
def test_deep_nesting_does_no_harm(tmp_path: Path, tag: str):
    deep = "<a>" * 100_000 + "</a>" * 100_000
    with pytest.raises(GdgError):
        take_in(write(tmp_path, f"<{tag}>{deep}</{tag}>"), tmp_path / "new", "acme")


def accept_or_refuse(folder: Path, text: str | bytes) -> None:
    with contextlib.suppress(GdgError):
        take_in(write(folder, text, "source/odd.xml"), folder / "new", "acme")
