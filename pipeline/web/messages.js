// Words that are told for a while, over the page.

const TOLD = { word: 6000, fault: 15000 }; // ms

/** Tell something in the element `message`; a fault longer, and in red. */
function tell(words, isFault = false) {
  const place = id("message");
  place.textContent = words;
  place.classList.toggle("fault", isFault);
  clearTimeout(tell.timer);
  tell.timer = setTimeout(() => { place.textContent = ""; }, isFault ? TOLD.fault : TOLD.word);
}
