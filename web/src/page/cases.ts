// The list of cases: searched, with thumbnails, kept fresh by events while one is prepared and by asking now and then.

import { getPicture, listCases, watchCase } from "../base/api.ts";
import type { Case } from "../model/case.ts";
import { NAMED_VIEWS } from "../model/camera.ts";
import { h, iconButton, setText } from "../base/dom.ts";
import { caseStatus, caseTitle, versionOf } from "../base/case-words.ts";
import { t } from "../base/i18n.ts";
import { decoded } from "../base/picture.ts";
import { problemWords } from "../base/problem-words.ts";
import { qualityOf } from "../model/quality.ts";
import { renderQuery } from "../model/query.ts";
import { firstState } from "../model/state.ts";

const IDLE_MS = 8000;
const THUMB_PIXELS = 96;
/** A browser opens six connections to a server; most of them are for pictures. */
const MOST_WATCHED = 2;
/** Cases beyond these events are asked about so often. */
const BUSY_MS = 1500;

export interface CaseListListener {
  /** The cases, or one of them, are not what they were. */
  changed(): void;
  remove(one: Case): void;
}

/** Whether a case is what the words look for: all of them, in its name, id or state. */
export function matches(one: Case, search: string): boolean {
  const text = `${caseTitle(one)} ${one.id} ${caseStatus(one)}`.toLowerCase();
  return search
    .toLowerCase()
    .split(/\s+/)
    .every((word) => text.includes(word));
}

const isBusy = (one: Case): boolean => one.state === "queued" || one.state === "preparing";

export class CaseList {
  readonly element: HTMLElement;
  cases: readonly Case[] = [];
  readonly #listener: CaseListListener;
  readonly #list = h("ul", { id: "case-list" });
  readonly #note = h("p", { id: "cases-note", class: "quiet", role: "status" }, t("cases.asking"));
  readonly #more: HTMLButtonElement;
  readonly #search: HTMLInputElement;
  readonly #rows = new Map<string, Row>();
  readonly #watched = new Map<string, AbortController>();
  readonly #onVisible = (): void => {
    if (!document.hidden) void this.refresh();
  };
  #older: readonly Case[] = [];
  #next: string | null = null;
  #marked: string | null = null;
  #timer = 0;
  #disposed = false;

  constructor(listener: CaseListListener) {
    this.#listener = listener;
    this.#search = h("input", {
      type: "search",
      id: "case-search",
      placeholder: t("cases.search"),
      "aria-label": t("cases.search"),
      input: () => void this.#searched(),
    });
    this.#more = h("button", { type: "button", hidden: true, click: () => void this.#loadOlder() }, t("cases.older"));
    this.element = h("div", { class: "case-list-box" }, this.#search, this.#note, this.#list, this.#more);
    document.addEventListener("visibilitychange", this.#onVisible);
  }

  /** Asks for the newest cases now, and again after a while. */
  async refresh(): Promise<void> {
    clearTimeout(this.#timer);
    try {
      const page = await listCases(null);
      if (this.#older.length === 0) this.#next = page.next ?? null;
      const fresh = new Set(page.cases.map((one) => one.id));
      this.cases = [...page.cases, ...this.#older.filter((one) => !fresh.has(one.id))];
      this.#say(this.cases.length === 0 ? t("cases.none") : "");
      this.#draw();
      this.#listener.changed();
    } catch (problem) {
      this.#say(problemWords(problem));
    }
    clearTimeout(this.#timer);
    const unwatched = this.cases.filter(isBusy).length > this.#watched.size;
    if (!document.hidden && !this.#disposed)
      this.#timer = window.setTimeout(() => void this.refresh(), unwatched ? BUSY_MS : IDLE_MS);
  }

  /** The id of the only case there is; null where there is none, or more. */
  get only(): string | null {
    return this.cases.length === 1 && !this.#next ? (this.cases[0]?.id ?? null) : null;
  }

  /** Marks the case that is shown. */
  mark(id: string | null): void {
    this.#marked = id;
    for (const [one, row] of this.#rows) row.mark(one === id);
  }

  dispose(): void {
    this.#disposed = true;
    clearTimeout(this.#timer);
    document.removeEventListener("visibilitychange", this.#onVisible);
    for (const controller of this.#watched.values()) controller.abort();
  }

  #say(words: string): void {
    setText(this.#note, words);
    this.#note.hidden = words === "";
  }

  async #searched(): Promise<void> {
    this.#draw();
    // What is looked for may be among the older ones.
    for (let page = 0; page < 20 && this.#next && this.#search.value.trim() !== ""; page += 1) await this.#loadOlder();
  }

  async #loadOlder(): Promise<void> {
    try {
      const page = await listCases(this.#next);
      this.#older = [...this.#older, ...page.cases];
      this.#next = page.next ?? null;
      await this.refresh();
    } catch (problem) {
      this.#say(problemWords(problem));
    }
  }

  #draw(): void {
    const present = new Set(this.cases.map((one) => one.id));
    for (const id of this.#rows.keys()) if (!present.has(id)) this.#rows.delete(id);
    // Rows are kept and altered, so that focus and screen readers stay where they are.
    const wanted = this.cases
      .filter((one) => matches(one, this.#search.value.trim()))
      .map((one) => {
        const row = this.#rows.get(one.id) ?? new Row(one, (doomed) => this.#listener.remove(doomed));
        this.#rows.set(one.id, row);
        row.show(one);
        return row.element;
      });
    const same =
      wanted.length === this.#list.children.length && wanted.every((row, at) => row === this.#list.children[at]);
    if (!same) this.#list.replaceChildren(...wanted);
    this.#more.hidden = this.#next === null;
    if (this.cases.length > 0) this.#say(wanted.length === 0 ? t("cases.no-match") : "");
    this.mark(this.#marked);
    this.#watch();
  }

  /** Follows the first of the cases that are being prepared. */
  #watch(): void {
    for (const one of this.cases.filter(isBusy)) {
      if (this.#watched.size >= MOST_WATCHED || this.#watched.has(one.id) || this.#disposed) continue;
      const controller = new AbortController();
      this.#watched.set(one.id, controller);
      const hear = (now: Case | null): void => {
        this.cases = now
          ? this.cases.map((other) => (other.id === now.id ? now : other))
          : this.cases.filter((other) => other.id !== one.id);
        this.#older = this.#older.map((other) => (other.id === now?.id ? now : other));
        this.#draw();
        this.#listener.changed();
      };
      watchCase(one.id, controller.signal, hear)
        // Asking now and then goes on, whatever becomes of the events.
        .catch(() => {})
        .finally(() => {
          this.#watched.delete(one.id);
          if (!this.#disposed) window.setTimeout(() => void this.refresh(), BUSY_MS / 3);
        });
    }
  }
}

/** One case of the list. */
class Row {
  readonly element: HTMLElement;
  readonly #link: HTMLAnchorElement;
  readonly #thumb = h("span", { class: "thumb", "aria-hidden": "true" });
  readonly #title = h("span", { class: "title" });
  readonly #status = h("span", { class: "status" });
  readonly #version = h("span", { class: "status", hidden: true });
  readonly #badge = h("span", { class: "quality-badge", hidden: true });
  readonly #bar = h("progress", { max: 1, "aria-label": t("case.progress"), hidden: true });
  readonly #delete: HTMLButtonElement;
  #case: Case;
  #thumbAsked = false;

  constructor(one: Case, remove: (one: Case) => void) {
    this.#case = one;
    this.#link = h(
      "a",
      { href: `#${one.id}` },
      this.#thumb,
      h("span", { class: "words" }, this.#title, this.#status, this.#version, this.#badge, this.#bar),
    );
    this.#delete = iconButton("trash", t("delete.button", { title: caseTitle(one) }), () => remove(this.#case));
    this.#delete.classList.add("delete");
    this.element = h("li", { "data-id": one.id }, this.#link, this.#delete);
  }

  show(one: Case): void {
    this.#case = one;
    this.element.dataset.state = one.state;
    setText(this.#title, caseTitle(one));
    setText(this.#status, caseStatus(one));
    const version = versionOf(one);
    setText(this.#version, version);
    this.#version.hidden = version === "";
    const quality = one.state === "ready" ? qualityOf(one) : null;
    this.#badge.hidden = !quality || quality.state === "ok";
    if (quality && quality.state !== "ok") {
      setText(this.#badge, t(`quality.${quality.state}`));
      this.#badge.dataset.verdict = quality.state;
    }
    this.#bar.hidden = one.state !== "preparing";
    if (one.state === "preparing") this.#bar.value = one.progress?.fraction ?? 0;
    if (one.state === "ready") void this.#showThumb(one);
  }

  mark(chosen: boolean): void {
    if (chosen) this.#link.setAttribute("aria-current", "true");
    else this.#link.removeAttribute("aria-current");
  }

  async #showThumb(one: Case & { state: "ready" }): Promise<void> {
    if (this.#thumbAsked) return;
    this.#thumbAsked = true;
    try {
      const state = { ...firstState(one), orientation: NAMED_VIEWS.left, way: "exact" } as const;
      const image = await decoded(
        await getPicture(`${one.id}/render?${renderQuery(state, [THUMB_PIXELS, THUMB_PIXELS])}`),
      );
      image.alt = "";
      this.#thumb.replaceChildren(image);
    } catch {
      // A list without the picture is still a list; the next drawing of the row tries again.
      this.#thumbAsked = false;
    }
  }
}
