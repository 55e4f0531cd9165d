// The list of cases, kept fresh by asking again: often while something is being prepared, seldom otherwise.

import { listCases } from "./api.js";
import { caseStatus, caseTitle } from "./scene.js";

const BUSY_MS = 700;
const IDLE_MS = 8000;

export class CaseList {
  /** The cases known, newest first. */
  cases = [];
  #onChange;
  #next = null;
  #older = [];
  #marked = null;
  #timer = 0;
  #list = document.getElementById("case-list");
  #note = document.getElementById("cases-note");
  #more = document.getElementById("more-cases");

  constructor({ onChange }) {
    this.#onChange = onChange;
    this.#more.addEventListener("click", () => this.#loadOlder());
    document.addEventListener("visibilitychange", () => document.hidden || this.refresh());
  }

  /** Asks for the first time, then again and again. */
  start() {
    return this.refresh();
  }

  /** Asks for the newest cases now. */
  async refresh() {
    clearTimeout(this.#timer);
    try {
      const page = await listCases();
      if (this.#older.length === 0) this.#next = page.next ?? null;
      const fresh = new Set(page.cases.map((one) => one.id));
      this.cases = [...page.cases, ...this.#older.filter((one) => !fresh.has(one.id))];
      this.note(this.cases.length === 0 ? "None yet." : "");
      this.#draw();
      this.#onChange();
    } catch (problem) {
      this.note(problem.message);
    }
    document.body.dataset.loaded = "true";
    const busy = this.cases.some((one) => one.state === "queued" || one.state === "preparing");
    clearTimeout(this.#timer);
    if (!document.hidden) this.#timer = setTimeout(() => this.refresh(), busy ? BUSY_MS : IDLE_MS);
  }

  /** Words above the list; empty for none. */
  note(words) {
    this.#note.textContent = words;
    this.#note.hidden = words === "";
  }

  /** Marks the case that is shown. */
  mark(id) {
    this.#marked = id;
    for (const link of this.#list.querySelectorAll("a")) {
      if (link.hash === `#${id}`) link.setAttribute("aria-current", "true");
      else link.removeAttribute("aria-current");
    }
  }

  async #loadOlder() {
    try {
      const page = await listCases(this.#next);
      this.#older.push(...page.cases);
      this.#next = page.next ?? null;
      await this.refresh();
    } catch (problem) {
      this.note(problem.message);
    }
  }

  #draw() {
    // Rows are kept and altered, so that focus and screen readers stay where they are.
    const rows = new Map([...this.#list.children].map((row) => [row.dataset.id, row]));
    const wanted = this.cases.map((one) => fill(rows.get(one.id) ?? makeRow(one), one));
    const same = wanted.length === rows.size && wanted.every((row, at) => row === this.#list.children[at]);
    if (!same) this.#list.replaceChildren(...wanted);
    this.#more.hidden = this.#next === null;
    this.mark(this.#marked);
  }
}

function makeRow(one) {
  const row = document.createElement("li");
  row.dataset.id = one.id;
  const link = row.appendChild(document.createElement("a"));
  link.href = `#${one.id}`;
  for (const part of ["title", "status"]) link.appendChild(document.createElement("span")).className = part;
  const bar = link.appendChild(document.createElement("progress"));
  bar.max = 1;
  bar.setAttribute("aria-label", "Preparation");
  return row;
}

function fill(row, one) {
  row.dataset.state = one.state;
  setText(row.querySelector(".title"), caseTitle(one));
  setText(row.querySelector(".status"), caseStatus(one));
  const bar = row.querySelector("progress");
  bar.hidden = one.state !== "preparing";
  bar.value = one.progress?.fraction ?? 0;
  return row;
}

function setText(element, text) {
  if (element.textContent !== text) element.textContent = text;
}
