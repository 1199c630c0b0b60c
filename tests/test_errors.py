"""Suggestions help and never crash."""

from __future__ import annotations

import pytest

from gdg.errors import GdgErrors, did_you_mean, raise_if_any


def test_the_nearest_name_is_suggested():
    assert did_you_mean("alegro", ["allegro", "barrett"]) == " Did you mean 'allegro'?"


def test_without_a_near_name_the_known_ones_are_listed():
    assert did_you_mean("zzz", ["b", "a"]) == " Known: a, b."


def test_a_long_list_is_cut():
    assert did_you_mean("zzz", [f"name{i:02}" for i in range(20)]).endswith("name11, ….")


def test_nothing_is_said_where_nothing_is_known():
    assert did_you_mean("x", []) == ""


def test_all_messages_are_kept_in_order():
    with pytest.raises(GdgErrors) as caught:
        raise_if_any(["first", "second"])
    assert caught.value.messages == ("first", "second")
    raise_if_any([])
