"""The cache: where it is, what stands in for it, and keys that cannot collide by accident."""

import os
import warnings
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from coslobe.core import cache


@pytest.fixture
def unwritable(tmp_path):
    """A folder that nobody can make, the administrator included: it would lie inside a file."""
    (tmp_path / "file").write_text("")
    return tmp_path / "file" / "cache"


def test_environment_variable_names_the_folder(tmp_path, monkeypatch):
    monkeypatch.setenv("COSLOBE_CACHE_DIR", str(tmp_path / "mine"))
    assert cache.folder() == tmp_path / "mine"
    assert cache.lasting()
    path = cache.entry("spheres", "abc", ".json")
    assert path == tmp_path / "mine" / "spheres" / "abc.json"
    assert path.parent.is_dir()
    assert not path.exists()


def test_user_folder_without_the_variable(tmp_path, monkeypatch):
    monkeypatch.delenv("COSLOBE_CACHE_DIR")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    assert cache.folder() == tmp_path / "coslobe"


def test_unwritable_folder_falls_back_with_one_warning(unwritable, monkeypatch):
    monkeypatch.setenv("COSLOBE_CACHE_DIR", str(unwritable))
    with pytest.warns(UserWarning, match="cannot be written") as caught:
        folders = [cache.folder() for _ in range(3)]
    assert len(caught) == 1
    assert str(unwritable) in str(caught[0].message)
    assert folders == folders[:1] * 3
    (folders[0] / "probe").write_text("")
    assert not cache.lasting()


def test_unwritable_user_cache_is_replaced_for_libraries_too(unwritable, monkeypatch):
    monkeypatch.delenv("COSLOBE_CACHE_DIR")
    monkeypatch.setenv("XDG_CACHE_HOME", str(unwritable))
    with pytest.warns(UserWarning, match="cannot be written") as caught:
        folder = cache.folder()
    assert len(caught) == 1
    assert Path(os.environ["XDG_CACHE_HOME"]) == folder.parent
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert cache.folder() == folder
        assert not cache.lasting()


values = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats(allow_nan=False) | st.text(),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(), inner, max_size=3),
    max_leaves=6,
)


@given(st.dictionaries(st.text(), values, max_size=5))
def test_order_of_keys_does_not_matter(settings):
    assert cache.digest(settings) == cache.digest(dict(reversed(settings.items())))


@given(st.lists(values, max_size=4), st.lists(values, max_size=4))
def test_equal_keys_mean_equal_parts(a, b):
    # repr tells 1, 1.0 and True apart as JSON does
    assert (cache.digest(*a) == cache.digest(*b)) == (repr(_ordered(a)) == repr(_ordered(b)))


def _ordered(value):
    if isinstance(value, dict):
        return {key: _ordered(value[key]) for key in sorted(value)}
    return [_ordered(item) for item in value] if isinstance(value, list) else value


def test_long_arrays_count_in_full():
    a, b = np.zeros(10_000), np.zeros(10_000)
    b[5_000] = 1e-12
    assert str(a) == str(b)
    assert cache.digest(a) != cache.digest(b)


def test_parts_without_json_form_are_refused():
    with pytest.raises(TypeError):
        cache.digest(object())
