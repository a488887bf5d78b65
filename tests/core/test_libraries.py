"""The system libraries that the Python packages load."""

from coslobe.core import libraries


def test_missing_are_those_that_do_not_load(monkeypatch):
    packages = {"libm.so.6": "libc6", "libnone-of-this-name.so.9": "libnone9"}
    monkeypatch.setattr(libraries, "DEBIAN_PACKAGES", packages)
    assert libraries.missing() == ["libnone-of-this-name.so.9"]


def test_nothing_is_missing_where_open3d_loads():
    import open3d  # noqa: F401

    assert not libraries.missing()
