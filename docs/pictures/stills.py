"""The six stills of the README, from those of docs/gallery.md: `make pictures`, or this file."""

from __future__ import annotations

from pathlib import Path

from PIL import Image

HERE = Path(__file__).parent
SHOWN = ("B020_inks", "B060_bloom", "B040_monument", "B080_motes", "B180_pool", "B100_torus")
COLUMNS, SIZE, GAP = 3, (480, 270), 4


def main() -> None:
    rows = -(-len(SHOWN) // COLUMNS)
    width, height = (n * (side + GAP) - GAP for n, side in zip((COLUMNS, rows), SIZE, strict=True))
    sheet = Image.new("RGB", (width, height), "white")
    for number, name in enumerate(SHOWN):
        row, column = divmod(number, COLUMNS)
        with Image.open(HERE / "gallery" / f"{name}.webp") as still:
            small = still.convert("RGB").resize(SIZE, Image.Resampling.LANCZOS)
        sheet.paste(small, (column * (SIZE[0] + GAP), row * (SIZE[1] + GAP)))
    sheet.save(HERE / "stills.webp", quality=88, method=6)


if __name__ == "__main__":
    main()
