// Asks for one surface after the other, and hands each to the viewer. The answer waits until there is a new one.
(async () => {
  "use strict";
  const viewer = document.querySelector(".viewer");
  const say = (what, text) => { document.querySelector(`[data-live-${what}]`).textContent = text; };
  const stages = { carried: "carried along", first: "first surface", refined: "refined" };
  const number = value => value === null ? "–" : value.toFixed(value < 10 ? 2 : 1);
  let after = 0;
  for (;;) {
    let answer;
    try {
      const response = await fetch(`surface?after=${after}`);
      if (!response.ok) throw new Error(response.status);
      answer = await response.json();
    } catch {
      say("message", "The program does not answer: it has ended, or this page belongs to an earlier run.");
      await new Promise(done => setTimeout(done, 1000));
      continue;
    }
    after = answer.published;
    const surface = answer.surface;
    if (surface) {
      if (surface.mesh && viewer.show) viewer.show(surface.mesh);
      say("frame", surface.frame);
      say("stage", stages[surface.stage] || surface.stage);
      say("rate", number(surface.rate));
      say("late", number(surface.late_secs));
      say("left-out", surface.left_out);
      say("message", surface.message);
      document.body.dataset.surfaces = after;
    }
    if (answer.ended) { say("message", "The program has ended."); return; }
  }
})();
