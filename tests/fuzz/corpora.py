"""Small valid files from which mutations start, written by the program itself if it can write them."""

from __future__ import annotations

import json
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from careful_io.files import write_json
from pareto_ltl.logic import translate
from pareto_ltl.logic.automaton_files import write_automaton
from pareto_ltl.planning import plan_files
from pareto_ltl.planning.rates import FailureRate, Promise
from pareto_ltl.planning.records import Forest, Front, Objectives, Plan, PlannedPath, Tree
from pareto_ltl.settings import Settings, preset
from pareto_ltl.simulation.records import Deployment, write_deployments
from pareto_ltl.wind.netcdf import write_netcdf
from pareto_ltl.wind.records import WindField
from pareto_ltl.world.cells import decompose
from pareto_ltl.world.scene import Scene
from pareto_ltl.world.scene_files import write_cells, write_scene
from pareto_ltl_apps.studies.sweeps import SweepManifest, SweepPoint
from wind_laws.documents import first_law
from wind_laws.records import FORECAST, SPACE, TIME, WindEvidence, WindModes

FORMULAS = (
    *("F(a & F b & F c)", "!a U b", "F(a & F(b & F c)) | F(a & F(d & F c))", "true", "X X a", "a M b"),
    *("F a & F b & F c & F d", "G a", "!(a W b)", "(a <-> b) xor !c", "F (a -> X b)", "[] a", "<> höhe"),
)
HOA = (
    'HOA: v1\nname: "F a"\nStates: 2\nStart: 0\nAP: 2 "a" "b"\nacc-name: Buchi\nAcceptance: 1 Inf(0)\n'
    "properties: trans-labels explicit-labels state-acc deterministic\n--BODY--\nState: 0\n[!0] 0\n[0] 1\n"
    "State: 1 {0}\n[t] 1\n--END--\n",
    'HOA: v1\nStates: 2\nStart: 0\nAP: 2 "a" "b"\nAlias: @x 0 & !1\nAlias: @y (@x | @x) & !@x\n'
    "Alias: @z !@y\nAcceptance: 1 Inf(0) /* a comment */\n--BODY--\nState: 0\n[@x] 1\n[!@x & @z] 0\n"
    "State: 1 {0}\n[t] 1\n--END--\n",
)
CSV = (
    b"time,lat,lon,u,v\n2018-10-09T00:00:00Z,30,-90,1.5,-2\n2018-10-09T00:00:00Z,31,-90,2.5,0\n"
    b"2018-10-09T06:00:00Z,30,-90,1,1\n2018-10-09T06:00:00+01:00,31,-91,1,1\n",
    b'"time","x","y","u","v","note"\n2018-10-09,0,1000,1.5,-2,"a, b"\n2018-10-09,1000,0,2.5,0,\n',
    b"time,lat,lon,u,v,lead_hours\n2018-10-09T00:00:00Z,30,-90,1.5,-2,0\n2018-10-09T06:00:00Z,30,-90,1,1,6\n",
    b"# model\ntime;lat;lon;u;v\n09.10.2018 06:00;30;-90;1,5;-2\n09.10.2018 07:00;30,5;-90;1;1\n",
    b"date,time,lat,lon,wind_speed_kt,wind_dir_degrees\n2018-10-09,06:00,30,-90,10,270\n",
    b"time,latitude,longitude,u,v\nUTC,degrees_north,degrees_east,m s-1,knots\n1539107580,30,-90,1.5,-2\n",
    "time\tlat\tlon\tu\tv\n2018-10-09T06:00Z\t30\t-90\t1\t1\n".encode("utf-16"),
)
STATIONS = (
    b"No errors\n5 results\nraw_text,station_id,observation_time,latitude,longitude,wind_dir_degrees,"
    b"wind_speed_kt,wind_gust_kt\nKBCT 220253Z 35007KT,KBCT,2022-10-22T02:53:00Z,26.38,-80.1,350,7,\n"
    b"KREO,KREO,2022-10-22T02:52:00Z,42.58,-117.87,0,3,20\n,PAFM,2022-10-22T03:52:00Z,67.1,-157,9,,\n",
    b"station,valid,lon,lat,drct,sknt,gust,uwind,vwind\nYUM,1993-03-12 06:00:00,-114.6,32.6,330,9,,4.5,-7\n"
    b"SDB,1993-03-12 06:59:00,-118.7253,34.7434,M,M,M,,\n",
    b"icaoId,obsTime,wdir,wspd,lat,lon\nKSGF,1539107580,270,10,37.2,-93.4\nKSTL,1539107580,VRB,3,38.7,-90.4\n",
    b'STATION,DATE,LATITUDE,LONGITUDE,WND\n724400,2018-10-09T17:53:00,37.2,-93.4,"270,1,N,0046,1"\n',
    b"STATION,DATE,LATITUDE,LONGITUDE,HourlyWindDirection,HourlyWindSpeed\n7244,2018-10-09T17:53,37,-93,270,10s\n",
    b"#STN LAT LON YYYY MM DD hh mm WDIR WSPD GST\n#text deg deg yr mo day hr mn degT m/s m/s\n"
    b"41001 34.7 -72.3 2018 10 09 17 50 270 5.0 MM\n",
    b"Station_ID|Year|Month|Day|Hour|Minute|Latitude|Longitude|wind_direction|wind_speed\n"
    b"USW1|2018|10|9|17|53|35|-93|270|5.0\n",
    b'[{"icaoId":"KSGF","obsTime":1539107580,"wdir":270,"wspd":10,"lat":37.2,"lon":-93.4}]',
    b'{"features":[{"geometry":{"coordinates":[-93,35]},"properties":{"station":"a/K1",'
    b'"timestamp":"2018-10-09T17:53:00Z","windDirection":{"value":270},'
    b'"windSpeed":{"unitCode":"wmoUnit:km_h-1","value":18.5}}}]}',
)
INVENTORIES = (
    b"1:0:d=2018100906:TMP:2 m above ground:3 hour fcst:\n"
    b"2:150:d=2018100906:UGRD:10 m above ground:3 hour fcst:\n"
    b"3:290:d=2018100906:VGRD:10 m above ground:3 hour fcst:\n4:400:d=2018100906:PRES:surface:anl:\n",
    b"77.1:0:d=2018100906:UGRD:10 m above ground:anl:\n"
    b"77.2:0:d=2018100906:VGRD:10 m above ground:anl:ENS=+1\n",
    b"1:0:d=2026051800:WIND:10 m above ground:1 hour fcst:\n"
    b"2:9:d=2026051800:WIND:10 m above ground:1 hour fcst:ens std dev\n"
    b"3:14:d=2026051800:WDIR:10 m above ground:1 hour fcst:\n",
    b'{"type": "fc", "step": "0", "levtype": "sfc", "param": "10u", "_offset": 0, "_length": 224}\n'
    b'{"type": "fc", "step": "0", "levtype": "sfc", "param": "10v", "_offset": 224, "_length": 300}\n'
    b'{"type": "fc", "levelist": "925", "levtype": "pl", "param": "u", "_offset": 524, "_length": 9}\n',
)
SQUARE = [[1.0, 1.0], [2.0, 1.0], [2.0, 2.0], [1.0, 2.0]]


def ring(lon: float, lat: float, half: float = 0.1) -> list[list[float]]:
    """A closed square of GeoJSON [deg]."""
    west, south, east, north = lon - half, lat - half, lon + half, lat + half
    return [[west, south], [east, south], [east, north], [west, north], [west, south]]


def feature(role: str, kind: str, coordinates: Any, **properties: Any) -> dict[str, Any]:
    shape = {"type": kind, "coordinates": coordinates}
    return {"type": "Feature", "properties": {"role": role, **properties}, "geometry": shape}


GEOJSON = {
    "type": "FeatureCollection",
    "features": [
        feature("start", "Point", [5.0, 60.0]),
        feature("region", "Polygon", [ring(5.5, 60.5)], name="a"),
        feature("obstacle", "Polygon", [ring(5.25, 60.25), ring(5.25, 60.25, 0.05)], name="Stord"),
        feature("obstacle", "MultiPolygon", [[ring(5.05, 60.5, 0.02)], [ring(5.1, 60.6, 0.02)]]),
        feature("landmark", "Polygon", [ring(5.5, 60.1)]),
        feature("obstacle", "LineString", [[5.1, 60.3], [5.15, 60.35]], buffer=300, floor=0, until="6h"),
        feature("bounds", "Polygon", [ring(5.3, 60.3, 0.6)]),
    ],
}


KML = """<?xml version="1.0" encoding="UTF-8"?><kml xmlns="http://www.opengis.net/kml/2.2"><Document>
<Placemark><name>start</name><Point><coordinates>5.0,60.0</coordinates></Point></Placemark>
<Folder><name>Regions</name><Placemark><name>a</name><TimeSpan><begin>2h</begin></TimeSpan><Polygon>
<outerBoundaryIs><LinearRing><coordinates>5.2,60.2,0 5.4,60.2,0 5.4,60.4,0</coordinates></LinearRing>
</outerBoundaryIs><innerBoundaryIs><LinearRing><coordinates>5.33,60.25 5.35,60.25 5.35,60.27</coordinates>
</LinearRing></innerBoundaryIs></Polygon></Placemark></Folder><Folder><name>Obstacles</name><Placemark>
<ExtendedData><Data name="buffer"><value>300</value></Data></ExtendedData><LineString><coordinates>5.1,60.3
5.15,60.35</coordinates></LineString></Placemark></Folder></Document></kml>
"""


def scene() -> Scene:
    square = np.array(SQUARE) * 1e5
    east = np.array([3e5, 0.0])
    return Scene(
        bounds=np.array([[0.0, 0.0], [1e6, 1e6]]),
        start=np.array([5e4, 1e5 / 3]),
        regions={"a": square, "b": square + 2 * east},
        obstacles=(square + east,),
        crs="+proj=stere +lat_0=37 +lon_0=-92 +k=1 +datum=WGS84 +units=m +no_defs",
        time_zero="2018-10-09T00:00:00Z",
        landmarks=(square + np.array([0.0, 5e5]),),
    )


def settings() -> dict[str, Any]:
    """All settings of a run, as ``config_resolved.yaml`` has them."""
    made = Settings()
    made.scene.regions, made.scene.obstacles = {"a": SQUARE}, [SQUARE]
    made.scene.bounds, made.scene.start = [[0.0, 0.0], [10.0, 10.0]], [0.5, 0.5]
    made.mission.formula = "F a"
    return asdict(made)


def flight(steps: int = 3) -> PlannedPath:
    rng = np.random.default_rng(1)
    return PlannedPath(
        t=1800.0 * np.arange(steps + 1),
        x=rng.normal(scale=1e5, size=(steps + 1, 2)),
        cov=np.tile(np.eye(2), (steps + 1, 1, 1)),
        q=np.arange(steps + 1),
        label=(frozenset(),) * steps + (frozenset({"a", "b"}),),
        u=rng.normal(size=(steps, 2)),
        objectives=Objectives({"length": 1234.5}, 1e-17, 0.3, 0.0, 0.7),
        origin="tree 3 vertex 1207",
        fixes=(1,),
    )


def tree(nodes: int = 4) -> Tree:
    rng = np.random.default_rng(2)
    whole, part = np.arange(nodes), rng.random(nodes)
    return Tree(
        *(rng.normal(size=(nodes, 2)), whole - 1, whole, 0 * whole, 0 * whole, part),
        *(rng.random((nodes, 2)), rng.random((2, 2, 4)), rng.random(2), 0.0, {"blocked": 3.0}),
    )


def wind() -> WindField:
    rng = np.random.default_rng(3)
    modes = WindModes(
        *(np.zeros(2), 5e5, rng.normal(size=(2, 2, 2, 2, 4)).astype(np.float32)),
        *(np.array([SPACE, FORECAST, TIME, -1]), 0.5, 21600.0, np.full((2, 2), 4e5), np.full((2, 2), 0.9)),
        rest_length=1e5,
    )
    mean = rng.normal(size=(2, 3, 3, 2))
    return WindField(
        *(np.zeros(2), 5e5, np.array([0.0, 21600.0]), mean, mean**2, np.ones((2, 2)), 43200.0),
        score={"gp_z_sd": 1.0},
        source="two fields",
        modes=modes,
        evidence=WindEvidence(
            (mean[0, 0], mean[1, 0]), (mean[0, 1], mean[1, 1]), "matern12", np.ones((2, 2, 4))
        ),
        leads=np.array([0.0, np.nan]),
        ends="the last field is held for 6 h",
        error=first_law(),
    )


def write_run(place: Path, seed: int = 0) -> None:
    """A results directory of small records."""
    place.mkdir(parents=True)
    write_scene(place, scene())
    write_cells(place, decompose(scene()))
    write_automaton(place, translate("F(a & F b)", [(), ("a",), ("b",)]))
    write_netcdf(wind(), place / "wind.nc", scene())
    plan_files.write_forest(place, Forest((tree(), tree()), np.array([[0, 3], [1, 2]]), 0.0))
    rate, flown = FailureRate("coherent", 0.15, 0.13, 0.17, 20), flight()
    front = Front(
        (flown, flight(2)), (flown.objectives,), 0.5, np.ones(2), (rate, rate), (rate,),
        failed=np.zeros((2, 20), bool), models=preset("full"),
    )  # fmt: skip
    plan_files.write_front(place, front)
    told = ("F(a & F b)", ("a", "b"), 1800.0, 30.0, 0.05, "full", "threshold", (0.5, 0.25, 0.25))
    known = scene().frame.navigation(flown.t, flown.x, flown.u)
    made = Plan(flown, *told, {"alpha": 0.1}, Promise(rate, rate, 0.1, 0.2, False), known)
    plan_files.write_plan(place, made)
    x = np.zeros((5, 4, 2))
    flags = x[:, 0, 0] == 0, x[:, 0, 1] > 0, x[:, 0, 1] < 0
    write_deployments(place, {"coherent": Deployment("coherent", x, *flags)})
    (place / "config_resolved.yaml").write_text(yaml.safe_dump(settings(), sort_keys=False))
    record = {"status": "ok", "error": None, "measured": True, "argv": ["+experiment=phi1"], "inputs": {}}
    record |= {
        "overrides": [f"seed={seed}", "+experiment=phi1"],
        "packages": {"numpy": "2.1"},
        "name": "phi1",
    }
    record |= {"config_hash": "0" * 64, "name": "phi1", "seed": seed, "seconds": {"forest": 0.5}}
    write_json(place / "run.json", record)
    rates = {"runs_coherent": 200.0, "failure_coherent": 0.1, "failure_coherent_low": 0.05}
    rates |= {"completed": 1.0, "length_m": 1e6 + seed, "nodes_per_second": None, "run_seconds": 2.0}
    write_json(place / "metrics.json", rates)


def write_sweep(place: Path) -> None:
    """A sweep of two settings with two seeds each."""
    points = []
    for number in range(4):
        job = f"{number:016x}"
        write_run(place / job, number)
        points.append(SweepPoint(job, {"planner.n_max": str(100 * (number // 2)), "seed": str(number % 2)}))
    SweepManifest(tuple(points), ("planner.n_max", "seed"), ("+experiment=phi1",)).write_to(place)


def words() -> tuple[str, ...]:
    """Words of command lines: some right, some wrong, some foreign to Hydra."""
    return (
        *("+experiment=phi1", "seed=3", "planner.n_max=500", "scene=phi2", "fidelity=full", "wind=calm"),
        *("seed=0,1", "seed=range(0,3)", "mission.formula='F(a & F b)'", "mission.formula=F(a)", "-m"),
        *("scene.regions={a: [[0,0],[1,0],[0,1]]}", "planner.trees=1e9", "robot.dt=nan", "~scene", "--run"),
        *(
            "hydra.run.dir=/nowhere",
            "name=${seed}",
            "wind.path=${oc.env:HOME}",
            "scene.unit=1e308",
            "++a.b=c",
        ),
        *(
            "planner.trees=",
            "=3",
            "a=b=c",
            "seed=[1,2",
            "name='",
            "\\",
            "--config-dir",
            "nowhere",
            "-c",
            "é=ü",
        ),
        *(
            "+experiment=nothing",
            "experiment=phi1",
            "pipelines=compare",
            "pipelines.stages=[plan]",
            "+hydra=x",
        ),
        *("robot.u_max=1e400", "scene.bounds=[[0,0],[1,1]]", "name=../x", "hydra.job.chdir=true", "seed=-1"),
        *("planner.epsilon=glob(*)", "planner.epsilon=interval(0,1)", "a.b.c.d=1", "seed=0x10", "--cfg=job"),
        "seed=" + "9" * 5000,
    )


def json_trees(place: Path) -> dict[str, Any]:
    """The content of every JSON file of ``place``."""
    return {path.name: json.loads(path.read_text()) for path in place.glob("*.json")}
