// The operator's page: events change what stands there; what a person or a scanner types goes where it belongs.
"use strict";
(() => {
  const { begin, texts, h, fill, say, sound, soundOn } = Parts, View = ScreenView;
  const byId = (id) => document.getElementById(id), csrf = document.body.dataset.csrf;
  const state = begin.shown;
  let plan = begin.plan, beat = performance.now(), behind = begin.shown.now_s - Date.now() / 1000, source = null;
  let heard = "", since_ms = -1e9, pressed_ms = -1e9, typed = "";

  // ---- showing -------------------------------------------------------------------------------------------------

  function show() {
    const { view } = state, body = document.body.dataset;
    body.state = view.state; body.why = view.why; body.running = String(state.running);
    View.head(state);
    const anew = View.task(state, plan);
    View.nests(state, plan); View.queue(state); View.foot(state, plan);
    time();
    const now = `${view.state}/${view.why}/${(state.confirm || {}).question || ""}`;
    if (now !== heard) { if (heard) changed(view); heard = now; }
    else if (anew) focus();
  }

  /** The screen is in another state: it is heard, and what is to be done has the focus. */
  function changed(view) {
    since_ms = performance.now();
    if (view.state === "act") sound(view.why === "fault" ? "fail" : "act");
    if (view.state === "done") sound(view.bin.length || view.again.length ? "fail" : "pass");
    focus();
  }

  function focus() {
    const there = document.activeElement;
    if (there && there !== document.body && there.isConnected && there.closest("#menu, .again-form")) return;
    const target = byId("scan") || byId("primary");
    if (target) target.focus({ preventScroll: true });
  }

  function time() {
    const lost = performance.now() - beat > 1500;
    byId("lost").hidden = !lost;
    document.body.dataset.lost = String(lost);
    if (lost && source && source.readyState === EventSource.CLOSED) connect();
    View.times(state, plan, Date.now() / 1000 + behind);
  }

  async function take(changes) {
    Object.assign(state, changes);
    if (state.plan !== plan.id) {
      const answer = await fetch(`/plan?id=${encodeURIComponent(state.plan)}`);
      if (answer.ok) plan = await answer.json();
      if (plan.id !== state.plan) return;
    }
    show();
  }

  function connect() {
    if (source) source.close();
    source = new EventSource("/events");
    source.addEventListener("change", (e) => {
      const changes = JSON.parse(e.data);
      behind = changes.now_s - Date.now() / 1000;
      beat = performance.now();
      const keys = Object.keys(changes).filter((k) => k !== "now_s");
      if (keys.every((k) => k.startsWith("live ") && (state.running || !changes[k].length === !state[k].length))) { Object.assign(state, changes); View.readings(state, plan); } else take(changes);
    });
    source.addEventListener("beat", () => { beat = performance.now(); });
    source.addEventListener("out", () => { location.href = "/login"; });
  }

  // ---- doing ---------------------------------------------------------------------------------------------------

  // One after the other: a fast scanner's second answer must not stand under its first. A stop waits for nobody.
  let before = Promise.resolve();
  const command = (action, more) => action === "stop" ? send(action) : (before = before.then(() => send(action, more)));

  async function send(action, more) {
    const body = new URLSearchParams({ action, csrf, ...more });
    let answer;
    try {
      const response = await fetch("/command", { method: "POST", body, headers: { Accept: "application/json" } });
      if (response.status === 401) { location.href = "/login"; return; }
      answer = await response.json();
    } catch { answer = { error: texts.lost }; }
    tell(answer.error ? `⚠ ${answer.error}` : "", Boolean(answer.error));
    if (answer.error) sound("refused");
    onPurpose(answer.again || "");
  }

  function tell(words, problem) {
    const told = byId("told");
    told.classList.toggle("problem", problem);
    say(told, words);
  }

  /** The one thing to do in this state. A key that was on its way before the screen changed is no answer. */
  function primary(patience_ms = 500) {
    const { view, confirm } = state;
    if (performance.now() - since_ms < patience_ms) return;
    if (view.state === "scan" && Object.keys(state.waiting).length) command("start");
    if (view.state === "ready") command("start");
    if (view.state === "act" && view.why === "question") command("confirm", { question: confirm.question });
    if (view.state === "act" && view.why === "fault") command(view.again.length ? "resume" : "acknowledge");
    if (view.state === "done") command(!view.bin.length && view.again.length ? "resume" : "acknowledge");
  }

  /** What was scanned or typed: a unit's serial, or one of the cards. */
  function scanned(text) {
    const card = text.toUpperCase();
    if (card === "START" || card === "DONE" || card === "NEXT") primary();
    else if (card === "STOP") command("stop");
    else if (card === "CLEAR") command("clear");
    else if (text) command("scan", { serial: text });
  }

  // A unit that has passed already is taken again only by somebody who may, and who says why.
  function onPurpose(serial) {
    const there = byId("again");
    if (there) { there.remove(); focus(); }
    if (!serial || !View.may.again) return;
    const reason = h("input", { id: "reason", autocomplete: "off", minlength: "3", maxlength: "200", required: true });
    const form = h("form", { id: "again", class: "again-form" }, h("label", { for: "reason" }, texts.why_again), reason, h("button", { class: "second" }, texts.take_again), h("button", { type: "button", id: "leave", class: "out" }, texts.leave_it));
    form.addEventListener("submit", (e) => { e.preventDefault(); command("again", { serial, reason: reason.value.trim() }); });
    form.querySelector("#leave").addEventListener("click", () => { tell("", false); onPurpose(""); });
    byId("task").append(form);
    reason.focus();
  }

  function keyDown(e) {
    if (e.key === "F2") { e.preventDefault(); if (!e.repeat) primary(); return; }
    const there = document.activeElement, elsewhere = there.tagName !== "INPUT" && !e.ctrlKey && !e.altKey && !e.metaKey;
    if (!elsewhere) return;
    if (e.key === "Enter" && typed) {  // the end of what a scanner typed presses no button
      e.preventDefault();
      scanned(typed.trim());
      typed = "";
    } else if (e.key === "Escape" || e.key === "Tab") { typed = ""; tell("", false); }
    else if (e.key === "Backspace" && typed) typed = typed.slice(0, -1);
    else if (e.key.length === 1 && !(e.key === " " && !typed)) {
      if (byId("scan")) { byId("scan").focus(); return; }
      e.preventDefault();
      typed += e.key;
    } else return;
    if (typed) tell(`${texts.next_unit} ${typed}`, false);
  }

  /** Stop acts when it is pressed, not when it is let go; the click that follows says the same and is passed over. */
  function pressed(e) {
    if (e.button !== 0 || !e.target.closest("#stop")) return;
    pressed_ms = performance.now();
    command("stop");
  }

  function clicked(e) {
    const button = e.target.closest("button");
    if (!button) { if (!e.target.closest("a, input, label, summary, .sheet")) focus(); return; }
    if (button.id === "primary") primary(e.detail === 0 ? 500 : 250);
    if (button.id === "stop" && performance.now() - pressed_ms > 1000) command("stop");
    if (button.id === "start") command("start");
    if (button.id === "resume") command("resume");
    if (button.classList.contains("out") && button.dataset.serial) command("take-out", { serial: button.dataset.serial });
  }

  if (csrf !== undefined) {
    document.addEventListener("submit", (e) => {
      if (e.target.id !== "scan-form") return;
      e.preventDefault();
      const text = byId("scan").value.trim();
      byId("scan").value = "";
      scanned(text);
    });
    document.addEventListener("keydown", keyDown);
    document.addEventListener("pointerdown", pressed);
    document.addEventListener("click", clicked);
  }
  const loud = byId("sound");
  loud.setAttribute("aria-pressed", String(soundOn()));
  loud.addEventListener("click", () => {
    localStorage.setItem("sound", soundOn() ? "off" : "on");
    loud.setAttribute("aria-pressed", String(soundOn()));
    sound("pass");
  });
  document.addEventListener("click", (e) => { if (!e.target.closest("#menu")) byId("menu").open = false; });
  show(); focus(); connect();
  setInterval(time, 250);
})();
