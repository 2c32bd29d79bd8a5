"""The judge of the built site finds links that lead nowhere, and files that a network would have to provide."""

from __future__ import annotations

from pathlib import Path

from pages.built_site import faults, main

WHOLE = '<h1 id="top">A</h1><a href="b.html#c">b</a><a href="#top">up</a><a href="https://example.org">out</a>'
OTHER = '<h1 id="c">B</h1><a href="a.html">a</a><img src="picture.png"><img src="data:image/png;base64,AA">'


def site(folder: Path, first: str = WHOLE, second: str = OTHER) -> Path:
    (folder / "a.html").write_text(first)
    (folder / "b.html").write_text(second)
    (folder / "picture.png").touch()
    return folder


def test_whole_site_has_no_fault(tmp_path: Path) -> None:
    assert faults(site(tmp_path)) == ([], 6)
    assert main(tmp_path) == 0


def test_broken_links_are_named(tmp_path: Path) -> None:
    broken = '<a href="c.html">c</a><a href="b.html#d">d</a><a href="#nowhere">e</a>'
    found, _ = faults(site(tmp_path, broken))
    assert found == [
        "a.html: c.html: no such file",
        "a.html: b.html#d: no such heading",
        "a.html: #nowhere: no such heading",
    ]
    assert main(tmp_path) == 1


def test_address_of_a_network_is_a_fault(tmp_path: Path) -> None:
    loading = '<link rel="stylesheet" href="https://fonts.example.org/x.css"><script src="//example.org/x.js"></script>'
    found, _ = faults(site(tmp_path, loading))
    assert len(found) == 2
    assert all("from a network" in one for one in found)


def test_empty_site_is_a_fault(tmp_path: Path) -> None:
    assert main(tmp_path) == 1
