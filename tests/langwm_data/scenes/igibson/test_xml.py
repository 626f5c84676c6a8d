"""XML is read without ever growing or naming anything else."""

import pytest

from langwm_data.scenes.igibson import xml
from langwm_data.scenes.igibson.xml import parse_xml

BOMB = b"""<?xml version="1.0"?><!DOCTYPE robot [<!ENTITY a "ha"><!ENTITY b "&a;&a;&a;&a;&a;&a;&a;&a;">
<!ENTITY c "&b;&b;&b;&b;&b;&b;&b;&b;&b;&b;">]><robot name="&c;"/>"""
OUTSIDE = b'<!DOCTYPE robot [<!ENTITY x SYSTEM "file:///etc/passwd">]><robot name="a">&x;</robot>'


@pytest.mark.parametrize(
    "data", [BOMB, OUTSIDE, b'<!DOCTYPE robot SYSTEM "http://example.org/x.dtd"><robot/>']
)
def test_declarations_are_refused(data):
    with pytest.raises(ValueError, match="scene: declares a document type or entities"):
        parse_xml(data, "scene")


@pytest.mark.parametrize("data", [b"", b"<robot>", b"<a></b>", b"<a/><b/>", b'<a b="&x;"/>', b"\xff\xfe\0"])
def test_damaged_documents_are_refused(data):
    with pytest.raises(ValueError, match="scene: damaged XML"):
        parse_xml(data, "scene")


def test_deep_and_large_documents_are_refused(monkeypatch):
    with pytest.raises(ValueError, match="more than 30 in each other"):
        parse_xml(b"<a>" * 31 + b"</a>" * 31, "scene")
    monkeypatch.setattr(xml, "MAX_ELEMENTS", 3)
    with pytest.raises(ValueError, match="more than 3 elements"):
        parse_xml(b"<a><b/><b/><b/></a>", "scene")


def test_elements_and_attributes_are_read_in_their_order():
    root = parse_xml(
        b'<?xml version="1.0"?><!-- note --><a x="1"> <b y="2"/> text <c/><b y="3"/></a>', "scene"
    )
    assert (root.tag, root.attributes) == ("a", {"x": "1"})
    assert [child.attributes["y"] for child in root.all("b")] == ["2", "3"]
    assert root.first("c") is not None
    assert root.first("d") is None
