"""Notes on the page: written, drawn and decided by keys, and kept."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from playwright.sync_api import Browser

from flowsculpt.pipeline.plugins.review.review_notes import read_notes
from tests.chromium import wait_for
from tests.plugins.review.looker import Looker, Opened, downloaded, drawn, notes_of, written
from tests.plugins.review.note_cases import ATTACK, IDS, note, revision, stroke


def test_notes_are_written_decided_and_kept_by_keys_alone(opened: Opened, page: Callable[..., Path]) -> None:
    look, place = opened(at := page(), frame=3), at
    look.press("q")
    look.tab.get_by_label("Your name").fill("Ann")
    look.press("Tab")
    written(look, f"softer {ATTACK}")
    look.press("8", "i", "ArrowRight", "ArrowRight", "o")
    written(look, "good", key="Shift+N")
    look.press("9", "\\", "Home", "a", "Escape")
    facts = [(n["first"], n["last"], n["status"], n["author"], n["sequence"]) for n in notes_of(look)]
    assert facts == [(3, 3, "change", "Ann", "draft"), (3, 5, "approved", "Ann", "draft")]
    assert ATTACK in look.tab.inner_text("#panel-notes")
    look = opened(place)
    assert look.ask("review.tab") == "notes" and len(notes_of(look)) == 2
    look.press("'", "'")
    assert look.frame == 3
    look.press("Delete")
    assert len(notes_of(look)) == 1 and look.ask("review.notes.notes.size") == 2
    look.press("u", "r")
    look.tab.keyboard.type(" indeed")
    look.press("Control+Enter")
    (edited,) = (n for n in notes_of(look) if n["status"] == "approved")
    assert edited["text"] == "good indeed" and [n["text"] for n in edited["history"]] == ["good"]
    look.press("2")
    assert "softer" not in look.tab.inner_text("#panel-notes"), "B has notes of its own"


def test_drawings_lie_on_the_picture_at_any_size_and_on_their_frame(
    opened: Opened, page: Callable[..., Path]
) -> None:
    look = opened(page(), frame=4)
    plain = look.picture().astype(int)
    look.press("3", "}", "}")
    drawn(look, (0.1, 0.75), (0.5, 0.75), (0.9, 0.75))
    amber = np.array([255, 176, 0])

    def is_inked(x: float, y: float) -> bool:
        seen = look.picture()
        return bool(np.abs(seen[int(y * len(seen)), int(x * seen.shape[1])] - amber).max() < 40)

    assert is_inked(0.3, 0.75) and not is_inked(0.3, 0.9)
    points = notes_of(look)[0]["drawings"][0]["points"]
    assert points[:2] == pytest.approx([1000, 0.75 * 10000 * 270 / 480], abs=25)
    look.press("z")
    assert is_inked(0.3, 0.75)
    look.press("f", "ArrowRight")
    assert not is_inked(0.3, 0.75)
    look.press("y")
    assert np.abs(look.picture()[int(0.75 * len(plain)), 300].astype(int)).max() > 40, "onion skin"
    look.press("y", "ArrowLeft", "4")
    drawn(look, (0.2, 0.3), (0.6, 0.6))
    look.press("5")
    drawn(look, (0.2, 0.6), (0.4, 0.9))
    look.press("6")
    drawn(look, (0.5, 0.65))
    wait_for(look.tab, "document.activeElement.className === 'ink-words'")
    look.tab.keyboard.type(ATTACK)
    look.press("Enter")
    kinds = ["pen", "arrow", "rectangle", "text"]
    assert [each["kind"] for each in notes_of(look)[0]["drawings"]] == kinds
    look.press("u", "Control+z")
    assert [each["kind"] for each in notes_of(look)[0]["drawings"]] == kinds[:2]
    look.press("Shift+U", "Backspace", "Control+z")
    assert [each["kind"] for each in notes_of(look)[0]["drawings"]] == kinds[:3]
    look.ask("tell('')")
    look.press("Shift+H")
    assert np.abs(look.picture().astype(int) - plain).max() < 8, "hidden"
    look.press("Shift+H", "b")


def test_each_side_of_two_pictures_has_the_notes_of_its_own_sequence(
    opened: Opened, page: Callable[..., Path]
) -> None:
    look = opened(page(note()), b="T010_tiny · daily.scale50", frame=4)
    for mode, share in (("s", 1.6), ("w", 0.8)):
        look.press(mode, "5")
        drawn(look, (share, 0.2), (share + 0.1, 0.4))
        look.press("b")
    assert [each["sequence"] for each in notes_of(look)] == ["draft", "daily.scale50"]
    assert len(notes_of(look)[1]["drawings"]) == 2
    look.press("q")
    assert look.tab.locator(".note-sequence").all_inner_texts() == ["draft", "daily.scale50"]
    look.press("1")
    assert look.tab.locator(".note-card").count() == 1


def test_a_note_on_a_picture_is_shown_with_all_its_sequences(
    opened: Opened, page: Callable[..., Path]
) -> None:
    look = opened(page(note(sequence="gone", picture="ab")))
    assert notes_of(look) and look.ask("review.notes.of(review.a).length") == 0
    key = look.ask("review.a.fact(3, 'key')")
    look.ask("(n) => review.notes.merge([n])", note(id=IDS[1], sequence="v001 draft", picture=key))
    assert look.ask("review.notes.of(review.a).length") == 1
    look.press("q", "Shift+Q")
    assert "v001 draft" in look.tab.inner_text("#panel-notes")


def test_refused_storage_is_told_once_and_notes_stay_until_the_page_is_left(
    browser: Browser, page: Callable[..., Path], tmp_path: Path
) -> None:
    tab = browser.new_context(viewport={"width": 1200, "height": 720}).new_page()
    tab.add_init_script(
        "Object.defineProperty(window, 'localStorage', { get() { throw new Error('no'); } });"
    )
    tab.goto(page(note()).as_uri())
    wait_for(tab, "window.review")
    look = Looker(tab, tmp_path)
    told = look.tab.inner_text("#message")
    assert "keeps no notes: download them" in told
    look.ask("document.getElementById('message').textContent = ''")
    written(look, "one")
    assert len(notes_of(look)) == 2 and look.tab.inner_text(".notes-kept") == "Not kept: download"
    downloaded(look, "Shift+J")
    assert look.tab.inner_text(".notes-kept") == "Download"
    tab.context.close()


def test_what_is_being_written_survives_a_reload_and_is_downloaded(
    opened: Opened, page: Callable[..., Path]
) -> None:
    look = opened(at := page(), frame=3)
    look.press("a")
    assert look.ask("Object.keys(localStorage).every((key) => !key.includes(review.notes.all[0].id))")
    look.tab.keyboard.type("half a sent")
    with look.tab.expect_download() as download:
        look.tab.get_by_role("button", name="JSON").click()
    download.value.save_as(look.scratch / "notes.json")
    assert [each.text for each in read_notes(look.scratch / "notes.json")] == ["half a sent"]
    look.press("r")
    look.tab.keyboard.type("ence")
    look = opened(at, frame=3)
    assert [each["text"] for each in notes_of(look)] == ["half a sentence"]
    look.press("a", "Escape")
    assert len(look.ask("[...review.notes.notes.keys()]")) == 1, "a note that says nothing is dropped"


def test_undo_takes_back_words_and_whole_notes_step_by_step(
    opened: Opened, page: Callable[..., Path]
) -> None:
    look = opened(page(), frame=4)
    look.press("3")
    drawn(look, (0.1, 0.5), (0.5, 0.6), (0.9, 0.5))
    look.press("u")
    assert notes_of(look) == [], "a note of one stroke goes with it"
    look.press("Shift+U", "r")
    look.tab.keyboard.type("softer")
    look.press("Control+Enter", "8")
    for words, status in (("softer", "open"), ("", "open")):
        look.press("u")
        assert [(n["text"], n["status"], len(n["drawings"])) for n in notes_of(look)] == [(words, status, 1)]
    look.press("Shift+U", "Shift+U")
    (mine,) = notes_of(look)
    assert (mine["text"], mine["status"]) == ("softer", "change")
    theirs = {**mine, "status": "approved", "modified": "2099-01-01T00:00:00.000Z"}
    look.ask("(n) => review.notes.merge([n])", theirs)
    look.press("u")
    assert notes_of(look)[0]["status"] == "approved" and "stays as it is" in look.tab.inner_text("#message")
    look.press("b")


def test_frames_that_the_shot_does_not_have_are_refused_where_they_are_typed(
    opened: Opened, page: Callable[..., Path]
) -> None:
    look = opened(page(note()), frame=3)
    look.press("q", "'", "r")
    field = look.tab.get_by_label("Frames of the note")
    for wrong in ("twelve", "12-99", "3-", ""):
        field.fill(wrong)
        field.press("Enter")
        assert "which has 1–24: write 12, or 12-20" in look.tab.inner_text("#message"), wrong
    field.fill("9 - 7")
    field.press("Enter")
    assert [(each["first"], each["last"]) for each in notes_of(look)] == [(7, 9)]


def test_a_long_list_shows_the_chosen_note_and_can_be_narrowed_to_a_status(
    opened: Opened, page: Callable[..., Path]
) -> None:
    statuses = ("open", "change", "approved")
    many = [
        note(id=f"{i:08d}-0000-4000-8000-{'0' * 12}", status=statuses[i % 3], text=f"note {i} " * (i % 40))
        for i in range(300)
    ]
    look = opened(page(*many), frame=3)
    look.press("q", *["'"] * 40)
    inside = """(() => { const box = (name) => document.querySelector(name).getBoundingClientRect();
    const [card, list] = [box('.note-card.chosen'), box('.notes-list')];
    return card.top >= list.top - 1 && card.bottom <= list.bottom + 1; })()"""
    assert look.tab.locator(".note-card.chosen").inner_text().startswith("3–5") and look.ask(inside)
    assert look.tab.locator(".notes-counts button").all_inner_texts() == [
        "Open 100",
        "Change 100",
        "Approved 100",
    ]
    look.press("Shift+X", "Shift+X")
    assert set(look.tab.locator(".note-status").all_inner_texts()) <= {"Open", "Change"}
    assert look.tab.locator(".note-card").count() in (100, 101), "and the chosen one"
    look.tab.get_by_role("button", name="Change 100").click()
    assert look.tab.locator(".note-card").count() == 300
    look.press("Shift+X", "Shift+X", "Shift+X", "Shift+X")
    assert look.tab.locator(".note-card").count() == 300


def test_words_that_are_written_from_right_to_left_read_so(opened: Opened, page: Callable[..., Path]) -> None:
    words = "هذا (12)!"
    text = stroke(kind="text", points=[1000, 3000], text=words, width=96)
    look = opened(page(note(text=words, author="ليلى", drawings=[text]), note(id=IDS[1])), frame=3)
    look.press("q")
    (right, left) = look.ask(
        """[...document.querySelectorAll('.note-text')].map((each) => {
          const range = new Range(), box = each.getBoundingClientRect();
          range.selectNodeContents(each);
          return range.getBoundingClientRect().right > box.right - 2;
        })"""
    )
    assert right and not left
    assert look.tab.locator(".note-about bdi").first.inner_text() == "ليلى"
    assert f"1 stroke: “{words}”" in look.tab.locator(".note-extras").first.inner_text()
    assert look.ask(f"RIGHT_TO_LEFT.test('{words}'[0])") and not look.ask("RIGHT_TO_LEFT.test('a')")


def test_two_tabs_of_one_page_have_the_same_notes(opened: Opened, page: Callable[..., Path]) -> None:
    look = opened(at := page(), frame=3)
    other = look.tab.context.new_page()
    other.goto(at.as_uri())
    wait_for(other, "window.review")
    written(look, "softer")
    wait_for(other, "review.notes.all.length === 1")
    other.evaluate("review.notes.editUndoably(review.notes.all[0].id, {status: 'change'})")
    look.wait("review.notes.all[0].status === 'change'")
    assert [each["text"] for each in notes_of(look)] == ["softer"]
    other.close()


def test_axe_finds_nothing_on_notes(opened: Opened, page: Callable[..., Path]) -> None:
    others = [note(id=IDS[1], status="change", history=[revision()]), note(id=IDS[2], status="approved")]
    look = opened(page(note(drawings=[stroke(frame=3)]), *others), frame=3)
    for keys in (["'"], ["r"], ["Escape", "b"], ["Shift+Q", "?"]):
        look.press(*keys)
        assert look.findings() == [], keys
