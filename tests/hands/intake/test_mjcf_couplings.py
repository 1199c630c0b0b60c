"""Couplings, closed loops and actuators of MJCF: which joint follows which, what drives them."""

from __future__ import annotations

import math
from pathlib import Path

import mujoco
import numpy as np
import pytest
from descriptions import take
from kinematics import link_poses

from gdg.errors import GdgError
from gdg.hands.intake import Intake
from gdg.hands.urdf import Mimic, Urdf, read_urdf

BOX = '<geom type="box" size="0.01 0.01 0.02"/>'


def hand(rest: str, joints: tuple[str, ...] = ("a", "b", "c"), more: str = 'range="0 1"') -> str:
    """A palm with one finger whose joints have those names."""
    text = ""
    for name in reversed(joints):
        text = (
            f'<body name="link_{name}" pos="0 0 0.04"><joint name="{name}" axis="0 1 0" {more}/>'
            f"{BOX}{text}</body>"
        )
    return (
        '<mujoco><compiler angle="radian"/><worldbody>'
        f'<body name="palm">{BOX}{text}</body></worldbody>{rest}</mujoco>'
    )


def taken(folder: Path, text: str) -> tuple[Intake, Urdf, str]:
    intake = take(folder, text)
    return intake, read_urdf(intake.urdf), "\n".join(intake.repairs)


def equality(inner: str) -> str:
    return f"<equality>{inner}</equality>"


def tendon(*coefficients: tuple[str, float], more: str = "") -> str:
    joints = "".join(f'<joint joint="{name}" coef="{c}"/>' for name, c in coefficients)
    return f'<tendon><fixed name="t" {more}>{joints}</fixed></tendon>'


# -- couplings


def test_an_equality_of_joints_becomes_a_mimic(tmp_path: Path):
    rest = equality('<joint joint1="b" joint2="a" polycoef="0.1 0.5 0 0 0"/>')
    _, urdf, said = taken(tmp_path, hand(rest))
    assert urdf.joints["b"].mimic == Mimic("a", 0.5, 0.1)
    assert urdf.joints["a"].mimic is None
    assert "Joint 'b' follows 'a': 0.5 × its value + 0.1" in said


def test_references_shift_a_coupling(tmp_path: Path):
    rest = equality('<joint joint1="b" joint2="a" polycoef="0 2 0 0 0"/>')
    _, urdf, _ = taken(tmp_path, hand(rest, more='range="0 1" ref="0.3"'))
    mimic = urdf.joints["b"].mimic
    assert mimic is not None
    assert (mimic.multiplier, mimic.offset) == pytest.approx((2, -0.3))


def test_the_joint_that_is_driven_leads_whatever_the_order(tmp_path: Path):
    rest = equality('<joint joint1="b" joint2="a" polycoef="0.1 0.5 0 0 0"/>')
    rest += '<actuator><motor joint="b"/></actuator>'
    intake, urdf, _ = taken(tmp_path, hand(rest))
    mimic = urdf.joints["a"].mimic
    assert mimic is not None
    assert mimic.joint == "b"
    assert (mimic.multiplier, mimic.offset) == pytest.approx((2, -0.2))
    assert intake.actuated == ("b",)


def test_a_chain_of_equalities_is_followed_to_its_beginning(tmp_path: Path):
    rest = equality(
        '<joint joint1="c" joint2="b" polycoef="0.1 2 0 0 0"/>'
        '<joint joint1="b" joint2="a" polycoef="0.2 3 0 0 0"/>'
    )
    _, urdf, _ = taken(tmp_path, hand(rest))
    mimic = urdf.joints["c"].mimic
    assert mimic is not None
    assert mimic.joint == "a"
    assert (mimic.multiplier, mimic.offset) == pytest.approx((6, 0.5))


def test_a_curved_equality_is_fitted_and_said(tmp_path: Path):
    rest = equality('<joint joint1="b" joint2="a" polycoef="0 1 0.1 0 0"/>')
    _, urdf, said = taken(tmp_path, hand(rest))
    mimic = urdf.joints["b"].mimic
    assert mimic is not None
    assert (mimic.multiplier, mimic.offset) == pytest.approx((1.1, -0.0167), abs=1e-3)
    assert "its coupling to 'a' is curved; the nearest line is off by up to 0.016" in said


def test_an_equality_that_is_switched_off_couples_nothing(tmp_path: Path):
    rest = equality('<joint joint1="b" joint2="a" active="false"/>')
    assert taken(tmp_path, hand(rest))[1].joints["b"].mimic is None


def test_a_tendon_of_fixed_length_couples_its_joints(tmp_path: Path):
    rest = tendon(("a", 0.5), ("b", -1.0)) + equality('<tendon tendon1="t"/>')
    rest += '<actuator><motor joint="a"/></actuator>'
    _, urdf, _ = taken(tmp_path, hand(rest))
    mimic = urdf.joints["b"].mimic
    assert mimic is not None
    assert (mimic.joint, mimic.multiplier) == ("a", pytest.approx(0.5))


def test_a_tendon_with_next_to_no_play_couples_its_joints(tmp_path: Path):
    rest = tendon(("b", 0.007), ("a", -0.008), more='limited="true" range="-0.001 0.001"')
    rest += '<actuator><motor joint="a"/></actuator>'
    _, urdf, said = taken(tmp_path, hand(rest))
    mimic = urdf.joints["b"].mimic
    assert mimic is not None
    assert (mimic.joint, mimic.multiplier) == ("a", pytest.approx(8 / 7))
    assert "tendon 't', which leaves a play of 0.25" in said


def test_joints_on_one_driven_tendon_move_by_its_coefficients(tmp_path: Path):
    rest = tendon(("a", 1.0), ("b", 0.8))
    rest += '<actuator><position tendon="t" kp="2" forcerange="-3 3"/></actuator>'
    intake, urdf, said = taken(tmp_path, hand(rest))
    mimic = urdf.joints["b"].mimic
    assert mimic is not None
    assert (mimic.joint, mimic.multiplier) == ("a", pytest.approx(0.8))
    assert intake.actuated == ("a",)
    arm = 1 + 0.8 * 0.8
    assert intake.drives["a"].stiffness == pytest.approx(2 * arm**2)
    assert intake.drives["a"].force_limit == pytest.approx(3 * arm)
    assert "both are pulled by tendon 't'" in said


def test_a_joint_that_depends_on_two_is_left_and_said(tmp_path: Path):
    rest = tendon(("a", 1.0), ("b", 1.0), ("c", 1.0)) + equality('<tendon tendon1="t"/>')
    rest += '<actuator><motor joint="a"/><motor joint="b"/></actuator>'
    intake, urdf, said = taken(tmp_path, hand(rest))
    assert urdf.joints["c"].mimic is None
    assert intake.actuated == ("a", "b")
    assert "Joint 'c' depends on 'a' and 'b' (tendon 't'); a URDF can't say so" in said


def test_a_follower_without_limits_gets_them_carried_over(tmp_path: Path):
    rest = equality('<joint joint1="b" joint2="a" polycoef="0 -2 0 0 0"/>')
    text = hand(rest).replace('<joint name="b" axis="0 1 0" range="0 1"/>', '<joint name="b"/>')
    _, urdf, said = taken(tmp_path, text)
    assert (urdf.joints["b"].lower, urdf.joints["b"].upper) == (-2, 0)
    assert "Joint 'b': no limits; got those of what it follows." in said


# -- actuators


def test_gains_and_limits_of_a_position_servo_become_a_drive(tmp_path: Path):
    rest = (
        '<actuator><position joint="a" kp="3" kv="0.2" gear="2" forcerange="-1 4"/>'
        '<position joint="b" kp="3" ctrlrange="0 1"/></actuator>'
    )
    intake, _, _ = taken(tmp_path, hand(rest, more='range="0 1" damping="0.05"'))
    drive = intake.drives["a"]
    assert drive.stiffness == pytest.approx(12)
    assert drive.damping == pytest.approx(0.85)
    assert drive.force_limit == pytest.approx(8)
    assert intake.drives["b"].stiffness == pytest.approx(3)
    assert intake.actuated == ("a", "b")


def test_the_commands_of_a_motor_and_the_joints_limit_bound_its_force(tmp_path: Path):
    rest = '<actuator><motor joint="a" gear="3" ctrlrange="-2 2"/><motor joint="b"/></actuator>'
    text = hand(rest).replace('name="b"', 'name="b" actuatorfrcrange="-0.5 0.5"')
    intake, urdf, _ = taken(tmp_path, text)
    assert intake.drives["a"].force_limit == pytest.approx(6)
    assert intake.drives["b"].force_limit == pytest.approx(0.5)
    assert urdf.joints["b"].effort == pytest.approx(0.5)


def test_a_servo_without_joint_limits_gives_its_commands_range(tmp_path: Path):
    rest = (
        '<actuator><general joint="a" biastype="affine" gainprm="0.01" biasprm="0 -2 -0.1" '
        'ctrlrange="0 255"/></actuator>'
    )
    _, urdf, said = taken(tmp_path, hand(rest, more=""))
    assert (urdf.joints["a"].type, urdf.joints["a"].upper) == ("revolute", pytest.approx(1.275))
    assert "Joint 'a': no limits; got the range of its commands." in said


def test_a_tendon_through_space_drives_the_joints_it_passes(tmp_path: Path):
    text = hand(
        '<tendon><spatial name="s"><site site="p"/><site site="q"/></spatial></tendon>'
        '<actuator><motor name="pull" tendon="s"/></actuator>'
    )
    text = text.replace('<body name="palm">', '<body name="palm"><site name="p" pos="0.02 0 0"/>')
    text = text.replace('<joint name="b"', '<site name="q" pos="0.02 0 0.01"/><joint name="b"')
    intake, _, said = taken(tmp_path, text)
    assert intake.actuated == ("a", "b")
    assert "Actuator 'pull' does not act on joints directly" in said
    assert "'a', 'b'" in said


def test_without_actuators_nothing_is_said_to_be_driven(tmp_path: Path):
    intake, _, _ = taken(tmp_path, hand(""))
    assert (intake.actuated, intake.drives) == (None, {})


# -- closed loops


def four_bar(ground: float, crank: float, coupler: float, rocker: float) -> str:
    """A planar four-bar from a palm, closed by a connect; link lengths in metres.

    Crank and rocker stand upright at zero, the coupler hangs on the crank.
    """
    tilt = math.atan2(rocker - crank, ground)
    bar = '<geom type="capsule" size="0.004" fromto="0 0 0 {}"/>'
    return (
        '<mujoco><compiler angle="radian"/><worldbody><body name="palm">' + BOX +
        '<body name="crank" pos="0 0 0.03"><joint name="drive" axis="0 1 0" range="-0.4 0.4"/>'
        + bar.format(f"0 0 {crank}") +
        f'<body name="coupler" pos="0 0 {crank}" euler="0 {-tilt} 0">'
        '<joint name="follow" axis="0 1 0" range="-3 3"/>' + bar.format(f"{coupler} 0 0") +
        "</body></body>"
        f'<body name="rocker" pos="{ground} 0 0.03"><joint name="rock" axis="0 1 0"/>'
        + bar.format(f"0 0 {rocker}") + f'<site name="end" pos="0 0 {rocker}"/>' +
        "</body></body></worldbody>"
        f'<equality><connect body1="coupler" body2="rocker" anchor="{coupler} 0 0"/></equality>'
        '<actuator><position joint="drive" kp="5"/></actuator></mujoco>'
    )  # fmt: skip


def test_a_parallelogram_turns_its_rocker_with_the_crank(tmp_path: Path):
    intake, urdf, said = taken(tmp_path, four_bar(0.05, 0.04, 0.05, 0.04))
    follow, rock = urdf.joints["follow"].mimic, urdf.joints["rock"].mimic
    assert follow is not None
    assert rock is not None
    assert (follow.joint, follow.multiplier) == ("drive", pytest.approx(-1, abs=1e-4))
    assert (rock.joint, rock.multiplier) == ("drive", pytest.approx(1, abs=1e-4))
    assert (follow.offset, rock.offset) == (pytest.approx(0, abs=1e-4),) * 2
    assert intake.actuated == ("drive",)
    assert "Joint 'rock' is in a closed loop; it now follows 'drive'" in said
    assert urdf.joints["rock"].upper == pytest.approx(0.4, abs=1e-3)


def test_a_general_four_bar_is_followed_to_the_error_that_is_said(tmp_path: Path):
    text = four_bar(0.05, 0.03, math.hypot(0.05, 0.02), 0.05)
    _, urdf, said = taken(tmp_path, text)
    rock, follow = urdf.joints["rock"].mimic, urdf.joints["follow"].mimic
    assert rock is not None
    assert follow is not None
    assert 0.4 < rock.multiplier < 0.8
    gaps = []
    for drive in np.linspace(-0.4, 0.4, 9):
        values = {
            "drive": drive,
            "rock": rock.multiplier * drive + rock.offset,
            "follow": follow.multiplier * drive + follow.offset,
        }
        poses = link_poses(urdf, values)
        coupler_end = poses["coupler"] @ [math.hypot(0.05, 0.02), 0, 0, 1]
        gaps.append(np.linalg.norm(coupler_end - poses["rocker"] @ [0, 0, 0.05, 1]))
    assert max(gaps) < 0.004
    assert "off by at most 0.0" in said


def test_a_loop_that_closes_in_part_of_the_range_cuts_it(tmp_path: Path):
    text = four_bar(0.05, 0.03, math.hypot(0.05, 0.02), 0.05).replace("-0.4 0.4", "-0.4 3")
    text = text.replace('name="rock" axis="0 1 0"', 'name="rock" axis="0 1 0" range="-1 0.3"')
    _, urdf, said = taken(tmp_path, text)
    assert 0.3 < urdf.joints["drive"].upper < 1.0
    assert "Joint 'drive': range cut to -0.4 to " in said


def test_a_spring_decides_where_a_loop_leaves_freedom(tmp_path: Path):
    # a fifth joint makes the loop a five-bar; its spring holds it at zero
    text = four_bar(0.05, 0.04, 0.05, 0.04).replace(
        '<body name="rocker" pos="0.05 0 0.03">',
        '<body name="extra" pos="0.05 0 0.03"><joint name="soft" axis="0 1 0" range="-1 1" '
        f'stiffness="1" pos="0 0 -0.03"/>{BOX}<body name="rocker">',
    ).replace("</body></body></worldbody>", "</body></body></body></worldbody>")  # fmt: skip
    _, urdf, _ = taken(tmp_path, text)
    soft, rock = urdf.joints["soft"].mimic, urdf.joints["rock"].mimic
    assert soft is not None
    assert rock is not None
    assert soft.multiplier == pytest.approx(0, abs=0.02)
    assert rock.multiplier == pytest.approx(1, abs=0.05)


def test_a_loop_with_two_drivers_is_left_open_and_said(tmp_path: Path):
    text = four_bar(0.05, 0.04, 0.05, 0.04).replace(
        "<actuator>", '<actuator><position joint="rock" kp="5"/>'
    )
    intake, urdf, said = taken(tmp_path, text)
    assert intake.actuated == ("drive", "rock")
    assert urdf.joints["follow"].mimic is None
    assert "is left open: several joints drive it." in said


def test_a_hand_held_by_a_mocap_body_is_no_loop(tmp_path: Path):
    text = hand(equality('<weld body1="held" body2="link_a"/>')).replace(
        "<worldbody>", '<worldbody><body name="held" mocap="true"/>'
    )
    assert taken(tmp_path, text)[1].joints["a"].mimic is None


def test_the_closed_loop_is_mujocos(tmp_path: Path):
    """The simulated mechanism comes to rest where the couplings say."""
    text = four_bar(0.05, 0.03, math.hypot(0.05, 0.02), 0.05)
    _, urdf, _ = taken(tmp_path, text)
    model = mujoco.MjModel.from_xml_string(
        text.replace("<worldbody>", '<option gravity="0 0 0" timestep="0.001"/><worldbody>')
    )
    data = mujoco.MjData(model)
    model.dof_damping[:] = 0.05
    model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_CONTACT)
    data.ctrl[0] = 0.3
    for _ in range(3000):
        mujoco.mj_step(model, data)
    drive, rock = float(data.joint("drive").qpos[0]), float(data.joint("rock").qpos[0])
    mimic = urdf.joints["rock"].mimic
    assert mimic is not None
    assert mimic.multiplier * drive + mimic.offset == pytest.approx(rock, abs=0.02)


def test_a_hand_that_is_no_tree_after_all_is_refused(tmp_path: Path):
    with pytest.raises(GdgError, match="no body with shapes or joints"):
        take(tmp_path, "<mujoco><worldbody/></mujoco>")
