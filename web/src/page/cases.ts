// The list of cases: searched, with thumbnails, kept fresh by events while one is prepared and by asking now and then.

import { getPicture, listCases, watchCase } from "../base/api.ts";
import type { Case } from "../model/case.ts";
import { NAMED_VIEWS } from "../model/camera.ts";
import { h, iconButton, setText } from "../base/dom.ts";
import { caseFacts, caseStatus, caseTitle, versionOf } from "../base/case-words.ts";
import { spoken, t } from "../base/i18n.ts";
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
  /** A case that was flagged can be shown. */
  ready(one: Case): void;
}

/** Whether a case is what the words look for: all of them, in its name, id or state. */
export function matches(one: Case, search: string): boolean {
  const text = `${caseTitle(one)} ${one.id} ${caseStatus(one)}`.toLowerCase();
  return search
    .toLowerCase()
    .split(/\s+/)
    .every((word) => text.includes(word));
}

/** How the list is sorted. */
const ORDERS = ["newest", "label"] as const;

/** The cases in an order; they come newest first. */
export function sorted(cases: readonly Case[], order: (typeof ORDERS)[number]): readonly Case[] {
  if (order === "newest") return cases;
  const { compare } = new Intl.Collator(spoken(), { numeric: true, sensitivity: "base" });
  return [...cases].sort((a, b) => compare(caseTitle(a), caseTitle(b)));
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
  readonly #order: HTMLSelectElement;
  readonly #rows = new Map<string, Row>();
  /** A long list asks for the pictures of the rows in sight alone. */
  readonly #seen = new IntersectionObserver((entries) => {
    for (const { isIntersecting, target } of entries) {
      if (target instanceof HTMLElement) this.#rows.get(target.dataset.id ?? "")?.look(isIntersecting);
    }
  });
  readonly #watched = new Map<string, AbortController>();
  readonly #onVisible = (): void => {
    if (!document.hidden) void this.refresh();
  };
  /** Those to be pointed out, why, and whether they could be shown when last looked at. */
  readonly #flagged = new Map<string, { readonly why: string; isReady: boolean }>();
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
    this.#order = h(
      "select",
      { id: "case-order", "aria-label": t("order.title"), change: () => this.#draw() },
      ...ORDERS.map((order) => h("option", { value: order }, t(`order.${order}`))),
    );
    const find = h("div", { class: "line" }, this.#search, this.#order);
    this.element = h("div", { class: "case-list-box" }, find, this.#note, this.#list, this.#more);
    this.#list.addEventListener("keydown", (event) => this.#walk(event));
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

  /** Points out a case, until it is chosen. */
  flag(id: string, why: string): void {
    if (id === this.#marked) return;
    const isReady = this.cases.some((one) => one.id === id && one.state === "ready");
    this.#flagged.set(id, { why, isReady });
    this.#draw();
    this.#rows.get(id)?.element.scrollIntoView({ block: "nearest" });
  }

  /** Marks the case that is shown. */
  mark(id: string | null): void {
    this.#marked = id;
    if (id) this.#flagged.delete(id);
    for (const [one, row] of this.#rows) {
      row.mark(one === id);
      row.flag(this.#flagged.get(one)?.why ?? "");
    }
  }

  dispose(): void {
    this.#disposed = true;
    this.#seen.disconnect();
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
    for (const [id, row] of this.#rows) {
      if (present.has(id)) continue;
      this.#seen.unobserve(row.element);
      this.#rows.delete(id);
    }
    // Rows are kept and altered, so that focus and screen readers stay where they are.
    const wanted = sorted(this.cases, this.#order.value === "label" ? "label" : "newest")
      .filter((one) => matches(one, this.#search.value.trim()))
      .map((one) => {
        const row = this.#rows.get(one.id) ?? new Row(one, (doomed) => this.#listener.remove(doomed));
        this.#rows.set(one.id, row);
        row.show(one);
        this.#seen.observe(row.element);
        return row.element;
      });
    const same =
      wanted.length === this.#list.children.length && wanted.every((row, at) => row === this.#list.children[at]);
    if (!same) this.#list.replaceChildren(...wanted);
    this.#more.hidden = this.#next === null;
    if (this.cases.length > 0) this.#say(wanted.length === 0 ? t("cases.no-match") : "");
    this.mark(this.#marked);
    for (const one of this.cases) {
      const flag = this.#flagged.get(one.id);
      if (!flag || flag.isReady || one.state !== "ready") continue;
      flag.isReady = true;
      this.#listener.ready(one);
    }
    this.#watch();
  }

  /** Arrows go from case to case. */
  #walk(event: KeyboardEvent): void {
    const step = { ArrowDown: 1, ArrowUp: -1 }[event.key];
    if (step === undefined || event.ctrlKey || event.metaKey || event.altKey) return;
    const links = [...this.#list.querySelectorAll("a")];
    const at = links.findIndex((link) => link.closest("li")?.contains(document.activeElement));
    event.preventDefault();
    links[at + step]?.focus();
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
  readonly #fresh = h("span", { class: "fresh-badge", hidden: true });
  readonly #bar = h("progress", { max: 1, "aria-label": t("case.progress"), hidden: true });
  readonly #delete: HTMLButtonElement;
  #case: Case;
  #isInSight = false;
  #thumbAsked = false;

  constructor(one: Case, remove: (one: Case) => void) {
    this.#case = one;
    this.#link = h(
      "a",
      { href: `#${one.id}`, click: (event: MouseEvent) => this.#stay(event) },
      this.#thumb,
      h(
        "span",
        { class: "words" },
        this.#title,
        h("span", { class: "facts" }, this.#fresh, this.#badge, this.#status, this.#version),
        this.#bar,
      ),
    );
    this.#delete = iconButton("trash", t("delete.button", { title: caseTitle(one) }), () => remove(this.#case));
    this.#delete.classList.add("delete");
    this.element = h("li", { "data-id": one.id }, this.#link, this.#delete);
  }

  show(one: Case): void {
    this.#case = one;
    this.element.dataset.state = one.state;
    setText(this.#title, caseTitle(one));
    this.#title.title = caseTitle(one);
    this.element.title = caseFacts(one);
    setText(this.#status, caseStatus(one));
    const version = versionOf(one);
    setText(this.#version, version);
    this.#version.hidden = version === "";
    // There is room for one of them.
    this.#status.hidden = version !== "" && one.state === "ready";
    const quality = one.state === "ready" ? qualityOf(one) : null;
    this.#badge.hidden = !quality || quality.state === "ok";
    if (quality && quality.state !== "ok") {
      setText(this.#badge, t(`quality.${quality.state}`));
      this.#badge.dataset.verdict = quality.state;
    }
    this.#bar.hidden = one.state !== "preparing";
    if (one.state === "preparing") this.#bar.value = one.progress?.fraction ?? 0;
    this.look(this.#isInSight);
  }

  /** Whether the row is in sight: its picture is asked for when it is. */
  look(isInSight: boolean): void {
    this.#isInSight = isInSight;
    if (isInSight && this.#case.state === "ready") void this.#showThumb(this.#case);
  }

  /** The case that is open stays as it is. */
  #stay(event: MouseEvent): void {
    if (this.#link.hasAttribute("aria-current")) event.preventDefault();
  }

  /** Says why the case is pointed out; empty: it is not. */
  flag(why: string): void {
    setText(this.#fresh, why);
    this.#fresh.hidden = why === "";
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
