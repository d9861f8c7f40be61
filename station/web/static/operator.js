// The operator's page: events change what is there; nothing is added to the page that is not replaced later.
"use strict";
(() => {
  const byId = (id) => document.getElementById(id);
  const { symbols, texts } = JSON.parse(byId("texts").textContent);
  const state = {};
  const scan = byId("scan"), form = byId("scan-form");
  let beat = performance.now(), behind = 0, source = null;

  const say = (node, words) => { if (node.textContent !== words) node.textContent = words; };
  const list = (node, lines) => {
    while (node.children.length > lines.length) node.lastChild.remove();
    lines.forEach((line, i) => {
      if (i >= node.children.length) node.append(document.createElement("li"));
      say(node.children[i], line);
    });
  };
  const figure = (v) => (v < 0 ? "−" : "+") + Math.abs(v).toFixed(4);

  function showNest(name, nest) {
    const box = document.querySelector(`[data-nest="${CSS.escape(name)}"]`);
    const part = (p) => box.querySelector(`[data-part="${p}"]`);
    const outcome = nest.scanned ? "" : nest.outcome || "";
    say(part("serial"), nest.serial || "");
    const words = outcome ? `${symbols[outcome]} ${texts[outcome]}`
      : nest.scanned ? `◌ ${texts.scanned}` : nest.serial && state.running ? `… ${texts.measuring}` : "–";
    say(part("verdict"), words);
    part("verdict").dataset.outcome = outcome;
    part("verdict").dataset.short = String(words.length < 8);
    say(part("next"), nest.next ? `${texts.next_unit} ${nest.next}` : "");
    say(part("device"), nest.device || "");
    const vector = !outcome && nest.vector && nest.vector.length ? nest.vector.map(figure).join("  ") : "";
    say(part("vector"), vector && `${vector} ${state.unit}`);
    say(part("noise"), outcome || nest.noise == null ? "" : `${texts.noise} ${nest.noise.toExponential(1)} ${state.unit}`);
    list(part("reasons"), outcome ? nest.reasons || [] : []);
  }

  function show(changed) {
    Object.assign(state, changed);
    for (const [key, value] of Object.entries(state)) if (key.startsWith("nest ") && (key in changed || "running" in changed)) showNest(key.slice(5), value);
    if ("now_svg" in changed) byId("now-picture").innerHTML = state.now_svg;
    if ("next_svg" in changed) byId("next-picture").innerHTML = state.next_svg;
    say(byId("now"), state.writing || state.position || "–");
    say(byId("next"), state.following || "–");
    say(byId("recipe"), state.recipe);
    say(byId("instruction"), state.instruction);
    bus(state.bus || {});
    people();
    say(byId("phase"), state.stopping ? texts.stopping : state.running ? texts[`phase_${state.phase}`] || state.phase : texts.idle);
    byId("bar").max = state.total || 1;
    byId("bar").value = state.done;
    say(byId("count"), state.total ? `${state.done} / ${state.total}` : "");
    byId("fault").hidden = !state.fault;
    say(byId("fault"), state.fault ? `⚠ ${state.fault}` : "");
    byId("golden").hidden = !state.golden || state.golden === state.fault;
    say(byId("golden"), state.golden ? `⚠ ${state.golden}` : "");
    list(byId("messages"), state.messages);
    document.querySelector(".messages").hidden = !state.messages.length;
    document.body.dataset.running = String(state.running);
    document.body.dataset.hand = String(Boolean(state.instruction || (state.confirm || {}).question));
    if (form) buttons();
    time();
  }

  function bus({ name, state: controller, counters }) {
    const errors = counters ? ` (${texts.bus_sending} ${counters.sending}, ${texts.bus_receiving} ${counters.receiving})` : "";
    say(byId("bus"), name ? `${name}: ${texts[`bus_${controller}`] || controller}${errors}` : "");
    byId("bus").classList.toggle("problem", Boolean(name) && !["active", "unknown"].includes(controller));
  }

  // What a person must do: confirm what the run asks, or change the units for the next load.
  let asked_ms = 0;
  function people() {
    const { confirm, question } = state.confirm || {};
    if (question !== byId("todo").dataset.question) asked_ms = performance.now();
    byId("todo").dataset.question = question || "";
    byId("todo").hidden = !question;
    say(byId("confirm"), confirm || "");
    const next = Object.entries(state.waiting || {}).filter(([nest]) => (state[`nest ${nest}`] || {}).next);
    const change = !state.running && next.length > 0;
    byId("coming").hidden = !change;
    say(byId("coming"), change ? `${texts.change_units} ${next.map(([nest, serial]) => `${nest}: ${serial}`).join(" · ")}` : "");
  }

  function buttons() {
    const nests = Object.entries(state).filter(([k]) => k.startsWith("nest ")).map(([, v]) => v);
    const open = nests.some((n) => n.serial && !n.scanned && !["PASS", "FAIL"].includes(n.outcome));
    const waits = Object.keys(state.waiting || {}).length > 0;
    byId("resume").hidden = state.running || !open || waits;
    byId("start").disabled = state.running || !waits;
    byId("clear").disabled = !waits;
    byId("stop").disabled = !state.running;
  }

  const clock = (s) => `${Math.floor(s / 60)}:${String(s % 60).padStart(2, "0")}`;
  function time() {
    const lost = performance.now() - beat > 1500;
    byId("lost").hidden = !lost;
    document.body.dataset.lost = String(lost);
    if (lost && source.readyState === EventSource.CLOSED) connect();
    const left = state.began_s + state.estimate_s - (Date.now() / 1000 + behind);
    say(byId("left"), state.running && state.phase !== "done" && state.estimate_s ? clock(Math.max(0, Math.ceil(left))) : "–");
  }

  function connect() {
    if (source) source.close();
    source = new EventSource("/events");
    source.addEventListener("change", (e) => {
      const changed = JSON.parse(e.data);
      behind = changed.now_s - Date.now() / 1000;
      beat = performance.now();
      show(changed);
    });
    source.addEventListener("beat", () => { beat = performance.now(); });
    source.addEventListener("out", () => { location.href = "/login"; });
  }

  // One after the other: a fast scanner's second answer must not stand under its first. A stop waits for nobody.
  let before = Promise.resolve();
  const command = (action, more) =>
    action === "stop" ? send(action) : (before = before.then(() => send(action, more)));

  async function send(action, more) {
    const body = new URLSearchParams({ action, csrf: form.dataset.csrf, ...more });
    let answer;
    try {
      const response = await fetch("/command", { method: "POST", body, headers: { Accept: "application/json" } });
      if (response.status === 401) { location.href = "/login"; return false; }
      answer = await response.json();
    } catch { answer = { error: texts.lost }; }
    const told = byId("told");
    told.classList.toggle("problem", Boolean(answer.error));
    say(told, answer.error ? `⚠ ${answer.error}` : answer.told ? `✔ ${answer.told}` : "");
    onPurpose(answer.again || "");
    return !answer.error;
  }

  // A unit that has passed already is taken again only by somebody who may, and who says why.
  const again = byId("again");
  function onPurpose(serial) {
    if (again) {
      again.hidden = !serial;
      again.dataset.serial = serial;
      byId("reason").value = "";
    }
    (serial ? byId("reason") : scan).focus();
  }

  function confirmed(waited_ms) {
    const question = byId("todo").dataset.question;
    if (question && waited_ms > 0) command("confirm", { question });
  }

  if (form) {
    form.addEventListener("submit", (e) => {
      e.preventDefault();
      const serial = scan.value.trim();
      scan.value = "";
      if (serial) command("scan", { serial });
    });
    for (const action of ["start", "stop", "resume", "clear"]) byId(action).addEventListener("click", () => command(action));
    byId("confirmed").addEventListener("click", () => confirmed(1));
    if (again) {
      again.addEventListener("submit", (e) => {
        e.preventDefault();
        command("again", { serial: again.dataset.serial, reason: byId("reason").value.trim() });
      });
      byId("leave").addEventListener("click", () => { say(byId("told"), ""); onPurpose(""); });
    }
    // A scanner types wherever the focus is: its characters belong to the scan field, whatever was touched last.
    document.addEventListener("keydown", (e) => {
      if (e.key === "F2" && !e.repeat) {
        e.preventDefault();
        confirmed(performance.now() - asked_ms - 500);  // a key that was on its way before the question is no answer
      }
      const elsewhere = document.activeElement.tagName !== "INPUT" && !e.ctrlKey && !e.altKey && !e.metaKey;
      if (elsewhere && e.key.length === 1 && e.key !== " ") scan.focus();
    });
    document.addEventListener("click", (e) => { if (!e.target.closest("a, button, input, label, summary")) scan.focus(); });
    scan.focus();
  }
  connect();
  setInterval(time, 250);
})();
