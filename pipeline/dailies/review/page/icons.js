"use strict";
// Drawn in lines of a 16 × 16 square, in the ink of the words around them.

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
};

function icon(name) {
  const svg = document.createElementNS("http://www.w3.org/2000/svg", "svg");
  svg.setAttribute("viewBox", "0 0 16 16");
  svg.setAttribute("aria-hidden", "true");
  const path = svg.appendChild(document.createElementNS("http://www.w3.org/2000/svg", "path"));
  path.setAttribute("d", ICONS[name]);
  return svg;
}
