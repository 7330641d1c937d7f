"""``plan.gpx`` (GPX 1.1): the expected positions as a route."""

from __future__ import annotations

from xml.etree import ElementTree as Xml

from pareto_ltl.exports.exported import ExportedPlan
from pareto_ltl.exports.xml_text import add, xml_bytes
from pareto_ltl.support.names import joined_names

NAMESPACE = "http://www.topografix.com/GPX/1/1"
OPENCPN = "http://www.opencpn.org"


def plan_gpx(exported: ExportedPlan) -> bytes:
    """The file: one ``rtept`` for each step, with its time if the map names a departure.

    ``ele`` is above mean sea level: it is written for pressure levels and depths. The height of the ground is
    unknown, so that heights above it are in the description.
    """
    log, height = exported.log, exported.height
    above = "" if height.of_sea else f", {height.metres:g} m above the ground of the start"
    root = Xml.Element(
        "gpx", {"version": "1.1", "creator": "pareto_ltl", "xmlns": NAMESPACE, "xmlns:opencpn": OPENCPN}
    )
    about = add(root, "metadata")
    add(about, "name", exported.name)
    add(about, "desc", " ".join(exported.sentences()))
    if log.utc is not None:
        add(about, "time", log.utc[0])
    route = add(root, "rte")
    add(route, "name", exported.name)
    if log.utc is not None:  # OpenCPN sets the departure of its table from it
        own = add(route, "extensions")
        add(own, "opencpn:planned_departure", log.utc[0])
    for k, (lat, lon) in enumerate(zip(log.lat, log.lon, strict=True)):
        point = add(route, "rtept", lat=f"{lat:.8f}", lon=f"{-180.0 if lon >= 180.0 else lon:.8f}")
        if height.of_sea:
            add(point, "ele", f"{height.metres:.1f}")
        if log.utc is not None:
            add(point, "time", log.utc[k])
        add(point, "name", f"{k}" if not exported.plan.path.label[k] else f"{k} {region_text(exported, k)}")
        add(point, "desc", f"95 % of positions within {log.radius[k] / 1e3:.3f} km, {log.law} winds{above}")
    return xml_bytes(root)


def region_text(exported: ExportedPlan, k: int) -> str:
    """The regions that step ``k`` is in."""
    return joined_names(exported.plan.path.label[k])
