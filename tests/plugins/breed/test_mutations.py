"""Children: whatever chance does, they are shots that validate, and the same seed makes the same."""

from __future__ import annotations

import copy
import random
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from flowsculpt.pipeline.plugins.breed.breeding import Litter, child_of
from flowsculpt.pipeline.plugins.breed.flow_mutations import MOTION, Draft, Idea, bounded, reseeded
from flowsculpt.pipeline.plugins.breed.gene_values import Chance
from flowsculpt.pipeline.plugins.breed.picture_mutations import (
    CLEAR_RIGS,
    FORM,
    MIRROR_RIGS,
    ON_GROUND,
    PICTURE,
    RIGS,
    relit,
)
from flowsculpt.pipeline.plugins.breed.shot_genome import Genome, flow_lists, leaves_of, text_of_shot
from flowsculpt.pipeline.shot import read_shot
from flowsculpt.pipeline.shot.yaml.yaml_source import YamlSource
from tests.needed_plugins import missing, needed_by, needs_plugins

SHOTS = Path("shots")
BREEDABLE = [
    "A010_cube",
    "A020_lorenz",
    "A030_taffy",
    "B010_honey",
    "B060_bloom",
    "B080_motes",
    "B120_pillars",
]
BREEDABLE = [name for name in BREEDABLE if not missing(*needed_by(SHOTS / f"{name}.yaml"))]
GENOMES: dict[str, Genome] = {}


def genome(name: str) -> Genome:
    if name not in GENOMES:
        GENOMES[name] = Genome.of(read_shot(SHOTS / f"{name}.yaml"))
    return GENOMES[name]


def draft(name: str, seed: int, change: float = 0.5) -> Draft:
    parent = genome(name)
    return Draft(parent, parent.copy(), Chance(random.Random(seed), change))


@settings(max_examples=40, deadline=None)
@given(name=st.sampled_from(BREEDABLE), seed=st.integers(0, 10**6), change=st.floats(0, 1))
def test_every_child_validates_and_extends_nothing(name: str, seed: int, change: float) -> None:
    child = child_of(Litter((genome(name),), seed, change, SHOTS), 1, "child")
    assert child is not None
    read_shot(SHOTS / "child.yaml", child.text, beside={})
    assert "extends" not in YamlSource.read(Path("child.yaml"), child.text).data
    assert child.shot.intent.startswith(name) and child.words
    assert child.shot.entries["breed.ancestry"].parents == [name]


@settings(max_examples=25, deadline=None)
@given(
    names=st.lists(st.sampled_from(BREEDABLE), min_size=2, max_size=2, unique=True),
    seed=st.integers(0, 10**6),
    change=st.floats(0, 1),
)
def test_every_cross_of_two_shots_validates(names: list[str], seed: int, change: float) -> None:
    child = child_of(Litter(tuple(map(genome, names)), seed, change, SHOTS), 1, "child")
    assert child is not None and child.shot.title.count(" × ") == 1
    assert child.shot.entries["breed.ancestry"].parents == names


@needs_plugins("points")
@pytest.mark.parametrize(
    "idea",
    [
        pytest.param(idea, marks=needs_plugins(*(["fields"] if idea is reseeded else [])))
        for idea in (*MOTION, *FORM, *PICTURE)
    ],
    ids=lambda idea: idea.__name__,
)
def test_a_single_mutation_changes_a_shot_and_it_still_validates(idea: Idea) -> None:
    changed = 0
    for name in BREEDABLE:
        for seed in range(2):
            made = draft(name, seed)
            if idea(made):
                read_shot(SHOTS / "child.yaml", text_of_shot(made.data), beside={})
                changed += made.data != made.parent.data
    assert changed > 0


def test_the_same_seed_gives_the_same_bytes_and_another_one_others() -> None:
    first, again, other = (
        [child_of(Litter((genome("A010_cube"),), seed, 0.3, SHOTS), n, "x") for n in range(1, 9)]
        for seed in (5, 5, 6)
    )
    texts = [[child.text for child in children if child] for children in (first, again, other)]
    assert texts[0] == texts[1]
    assert len({*texts[0], *texts[2]}) == 16


def test_a_pair_of_vortices_stays_a_pair_unless_a_mutation_breaks_it() -> None:
    kept = 0
    for number in range(1, 41):
        child = child_of(Litter((genome("A010_cube"),), 0, 0.3, SHOTS), number, "x")
        assert child is not None
        data: dict[str, Any] = YamlSource.read(Path("x"), child.text).data
        pair = [
            leaf.values for flows in flow_lists(data) for leaf in leaves_of(flows) if leaf.name == "vortex"
        ]
        if len(pair) == 2:
            left, right = (values["centre"] for values in pair)
            kept += left[0] == -right[0] and left[1] == right[1]
    assert kept >= 15


def test_no_change_gives_a_child_that_moves_as_its_parent_does() -> None:
    made = draft("A010_cube", 1, change=0.0)
    from flowsculpt.pipeline.plugins.breed.flow_mutations import drift

    before = copy.deepcopy(made.data["flows"])
    drift(made)
    assert made.data["flows"] == before


def test_files_that_a_shot_names_are_found_from_the_folder_of_its_children(tmp_path: Path) -> None:
    parent = Genome.of(read_shot(SHOTS / "B130_pulse.yaml"))
    data = parent.rebased(tmp_path / "bred")
    assert (tmp_path / "bred" / data["sound"]["file"]).resolve() == (SHOTS / "pulse.opus").resolve()


def test_the_text_of_a_genome_reads_back_as_its_data() -> None:
    for name in BREEDABLE:
        data = genome(name).data
        assert YamlSource.read(Path("x"), text_of_shot(data)).data == data


@pytest.mark.parametrize(
    ("look", "camera", "rigs"),
    [
        ("clay", {}, set(RIGS)),
        ("clay", {"dolly": 0.6}, {*RIGS, "macro"}),
        ("chrome", {}, set(MIRROR_RIGS)),
        ("glass", {}, set(CLEAR_RIGS)),
    ],
)
def test_light_suits_the_look_and_its_stage_the_light(
    look: str, camera: dict[str, Any], rigs: set[str]
) -> None:
    """Rigs whose horizon is seen stand on ground, which goes when they go."""
    one, seen = draft("A010_cube", 5), set()
    one.data |= {"look": look, "camera": camera}
    for _ in range(60):
        assert relit(one)
        seen.add(one.data["lights"])
        stage = one.data["stage"]
        kind = stage if isinstance(stage, str) else stage["kind"]
        assert (kind == "ground") == (one.data["lights"] in ON_GROUND)
        if len(seen) == len(rigs):
            break
    assert seen == rigs
    read_shot(SHOTS / "child.yaml", text_of_shot(one.data), beside={})


@pytest.mark.parametrize(
    ("flows", "words"),
    [
        ([{"placed": {"flows": [{"twist": {"amount": 3}}]}}], "the twist on"),
        ([{"sum": [{"vortex": {}}, {"mirrored": {"flows": [{"vortex": {}}]}}]}], "the vortices on"),
        ([{"sum": [{"vortex_ring": {}}, {"translation": {}}]}], "the vortex ring on"),
        ([{"sequence": {"flows": [{"twist": {}}, {"bend": {}}]}}], "the flows on"),
    ],
)
def test_a_flow_on_one_half_is_named_by_what_is_in_it(flows: list[Any], words: str) -> None:
    made = draft("A010_cube", 0)
    made.data["flows"] = flows
    told = bounded(made)
    assert told.startswith(words) and told.endswith(" half") and "within" in made.data["flows"][0]
