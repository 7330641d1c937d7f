"""Maps drawn at random."""

from __future__ import annotations

import pytest
from shapely import Point, Polygon, box

from pareto_ltl.settings import SceneConfig
from pareto_ltl.settings.mission import RandomSceneConfig
from pareto_ltl.support.errors import ConfigError
from pareto_ltl.world.scene_settings import add_random_places


def scene(**wanted: object) -> SceneConfig:
    return SceneConfig(
        bounds=[[0.0, 0.0], [20.0, 10.0]],
        start=[1.0, 1.0],
        regions={"a": [[10.0, 5.0], [12.0, 5.0], [11.0, 7.0]]},
        random=RandomSceneConfig(**wanted),  # type: ignore[arg-type]
    )


@pytest.mark.parametrize("seed", range(10))
def test_everything_lies_on_the_map_convex_and_apart(seed: int) -> None:
    made = add_random_places(scene(seed=seed, regions=3, obstacles=10, gap=0.03))
    assert list(made.regions) == ["a", "b", "c", "d"]
    assert len(made.obstacles) == 10
    shapes = [Polygon(p) for p in (*made.regions.values(), *made.obstacles)]
    for i, shape in enumerate(shapes):
        assert shape.is_valid
        assert shape.area == pytest.approx(shape.convex_hull.area, rel=1e-12)
        assert box(0, 0, 20, 10).contains(shape)
        assert shape.distance(Point(1.0, 1.0)) >= 0.3
        assert all(shape.distance(other) >= 0.3 - 1e-9 for other in shapes[i + 1 :])


def test_a_seed_is_a_map_and_another_seed_another() -> None:
    assert add_random_places(scene(seed=4, obstacles=3)) == add_random_places(scene(seed=4, obstacles=3))
    assert add_random_places(scene(seed=4, obstacles=3)) != add_random_places(scene(seed=5, obstacles=3))


def test_without_a_wish_a_scene_stays_as_it_is() -> None:
    plain = scene()
    assert add_random_places(plain) is plain


def test_more_than_fits_is_refused_with_what_to_change() -> None:
    with pytest.raises(ConfigError, match="do not fit the map; ask for fewer"):
        add_random_places(scene(obstacles=400))


@pytest.mark.parametrize(
    "wrong", [{"regions": -1}, {"regions": 27}, {"radius": [0.2, 0.1]}, {"radius": [0.1]}]
)
def test_wishes_out_of_range_name_their_key(wrong: dict[str, object]) -> None:
    with pytest.raises(ConfigError, match=f"scene.random.{next(iter(wrong))}"):
        RandomSceneConfig(**wrong)  # type: ignore[arg-type]
