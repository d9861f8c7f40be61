// Follows what is under way: its progress in place, the whole page once it has ended. A reader is never thrown back to
// the top of a page that reloads.
"use strict";
(() => {
  const FOLLOW_MS = 2000, place = document.getElementById("under-way");
  async function look() {
    try {
      const answer = await fetch(location.href), page = new DOMParser().parseFromString(await answer.text(), "text/html");
      const next = page.getElementById("under-way");
      if (!next) { location.reload(); return; }
      place.replaceChildren(...next.childNodes);
    } catch { /* The station is away for a moment: it is asked again. */ }
    setTimeout(look, FOLLOW_MS);
  }
  setTimeout(look, FOLLOW_MS);
})();
