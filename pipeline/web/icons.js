// Icons are drawn in lines of a 16 × 16 square, in the ink of the words around them.

const ICONS = {
  first: "M3.5 3v10M13 3.5 6.5 8l6.5 4.5z",
  back: "M11.5 3.5 5 8l6.5 4.5z",
  play: "M5 3v10l8-5z",
  pause: "M5 3.5v9M11 3.5v9",
  ahead: "M4.5 3.5 11 8l-6.5 4.5z",
  last: "M12.5 3v10M3 3.5 9.500 8 3 12.5z",
  swap: "M4 5.500h9M10.500 3 13 5.500 10.500 8M12 10.500H3M5.500 8 3 10.500 5.500 13",
  loopIn: "M9.500 3h-4v10h4",
  loopOut: "M6.500 3h4v10h-4",
  loopReset: "M3.500 4.500v7M12.500 4.500v7M6 6l4 4M10 6l-4 4",
  pen: "M3 13l.8-3.200L10.700 3.300a1.200 1.200 0 0 1 1.700 0l.3.3a1.200 1.200 0 0 1 0 1.700L5.800 12.200z",
  arrow: "M3 13 12.500 3.500M6.500 3.500h6v6",
  rectangle: "M2.500 4h11v8h-11z",
  text: "M3.500 4.500v-1h9v1M8 3.500v9M6.500 12.500h3",
  dot: "M8 3.500a4.500 4.500 0 1 0 0 9 4.500 4.500 0 0 0 0-9z",
  thinner: "M3.500 8h9",
  thicker: "M3.500 8h9M8 3.500v9",
  undo: "M6 3.500 3 6.500l3 3M3.500 6.500h6a3 3 0 0 1 0 6h-3",
  redo: "M10 3.500l3 3-3 3M12.500 6.500h-6a3 3 0 0 0 0 6h3",
  erase: "M3 4.500h10M6.500 4.500v-2h3v2M4.500 4.500l.7 9h5.600l.7-9",
  onion: "M2.500 2.500h7v7h-7zM6.500 6.500h7v7h-7z",
  close: "M4 4l8 8M12 4l-8 8",
};

function icon(name) { return svg("svg", { viewBox: "0 0 16 16", "aria-hidden": true }, svg("path", { d: ICONS[name] })); }
