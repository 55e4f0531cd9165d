// The list of cases: searched, sorted, of any length, kept fresh by asking; the server tells how far a case is.

import { listCases } from "../base/api.ts";
import { alike, caseFacts, caseTitle, shortTitle } from "../base/case-words.ts";
import { h, status, tell } from "../base/dom.ts";
import { spoken, t } from "../base/i18n.ts";
import { troubleWords } from "../base/problem-words.ts";
import { Progress } from "../base/progress.ts";
import type { Case } from "../model/case.ts";
import { qualityOf } from "../model/quality.ts";
import { ROW_PIXELS, isCovered, rowsInSight, scrolledTo } from "../model/rows.ts";
import { Row } from "./case-row.ts";
import { choice } from "./elements.ts";

const IDLE_MS = 4000;
/** While more cases are being prepared than are followed. */
const BUSY_MS = 1000;
/** So many cases are asked for together, behind the newest; and so many are listed at the most. */
const PAGE_CASES = 200;
const MOST_CASES = 10_000;
/** A row that stays in sight for so long gets its picture. */
const LOOK_MS = 120;

interface CaseListListener {
  /** The cases, or one of them, are not what they were. */
  changed(): void;
  remove(one: Case): void;
  /** A case that was flagged can be shown. */
  ready(one: Case): void;
}

/** Whether a case is what the words look for: all in its name, date or state, or as the beginning of its id. */
export function matches(one: Case, search: string): boolean {
  const text = caseFacts(one).toLowerCase();
  return search
    .toLowerCase()
    .split(/\s+/)
    .every((word) => text.includes(word) || one.id.startsWith(word));
}

/** How the list is sorted. */
const ORDERS = ["newest", "oldest", "label", "state"] as const;
type Order = (typeof ORDERS)[number];

/** What asks for a look comes first. */
function rankOf(one: Case): number {
  if (one.state === "failed") return 0;
  if (one.state !== "ready") return 1;
  return ["failed", "review"].indexOf(qualityOf(one)?.state ?? "") === -1 ? 3 : 2;
}

/** The cases in an order; they come newest first. */
export function sorted(cases: readonly Case[], order: Order): readonly Case[] {
  switch (order) {
    case "newest":
      return cases;
    case "oldest":
      return cases.toReversed();
    case "state":
      return cases.toSorted((a, b) => rankOf(a) - rankOf(b));
    case "label": {
      const { compare } = new Intl.Collator(spoken(), { numeric: true, sensitivity: "base" });
      return cases.toSorted((a, b) => compare(caseTitle(a), caseTitle(b)));
    }
  }
}

const isBusy = (one: Case): boolean => one.state === "queued" || one.state === "preparing";

export class CaseList {
  readonly element: HTMLElement;
  cases: readonly Case[] = [];
  /** The case that was chosen from the list last. */
  chosen: string | null = null;
  readonly #listener: CaseListListener;
  readonly #list = h("ul", { id: "case-list" });
  readonly #scroller = h("div", { class: "case-scroller", scroll: () => this.#stir() }, this.#list);
  readonly #note = status("cases-note");
  readonly #search: HTMLInputElement;
  readonly #order: HTMLSelectElement;
  readonly #rows = new Map<string, Row>();
  readonly #resized = new ResizeObserver(() => this.#stir());
  readonly #progress = new Progress((one) => this.#hear(one));
  readonly #onVisible = (): void => {
    if (!document.hidden) void this.refresh();
  };
  /** Those to be pointed out, why, and whether they could be shown when last looked at. */
  readonly #flagged = new Map<string, { readonly why: string; isReady: boolean }>();
  /** The cases that are looked for, in their order. */
  #wanted: readonly Case[] = [];
  /** Those that have the title of a case, by that title. */
  #titled: ReadonlyMap<string, readonly Case[]> = new Map();
  #newest: readonly Case[] = [];
  #older: readonly Case[] = [];
  #next: string | null = null;
  #marked: string | null = null;
  #timer = 0;
  #look = 0;
  #frame = 0;
  #isLoadingOlder = false;
  /** Whether the server has said which cases there are. */
  #isListed = false;
  #disposed = false;

  constructor(listener: CaseListListener) {
    this.#listener = listener;
    this.#search = h("input", {
      type: "search",
      id: "case-search",
      placeholder: t("cases.search"),
      "aria-label": t("cases.search"),
      input: () => this.#fromTop(),
    });
    this.#order = choice(
      "case-order",
      t("order.title"),
      ORDERS,
      (order) => t(`order.${order}`),
      () => this.#fromTop(),
    );
    this.#say(t("cases.asking"));
    const find = h("div", { class: "line" }, this.#search, this.#order);
    this.element = h("div", { class: "case-list-box" }, find, this.#note, this.#scroller);
    this.#list.addEventListener("keydown", (event) => this.#walk(event));
    this.#list.addEventListener("click", () => (this.chosen = this.#focusedId ?? null));
    this.#resized.observe(this.#scroller);
    document.addEventListener("visibilitychange", this.#onVisible);
  }

  /** Asks for the newest cases now, and again after a while. */
  async refresh(): Promise<void> {
    clearTimeout(this.#timer);
    try {
      const page = await listCases(null);
      if (this.#older.length === 0) this.#next = page.next ?? null;
      this.#newest = page.cases;
      this.#isListed = true;
      this.#merge();
      if (this.#next) void this.#loadOlder();
    } catch (problem) {
      this.#say(troubleWords(problem));
    }
    clearTimeout(this.#timer);
    if (document.hidden || this.#disposed) return;
    const isMore = this.cases.filter(isBusy).length > (this.#progress.isShared ? 1 : 0);
    this.#timer = window.setTimeout(() => void this.refresh(), isMore ? BUSY_MS : IDLE_MS);
  }

  /** A case has changed. */
  #hear(one: Case): void {
    // What the list does not hold yet comes with all that is new.
    if (!isBusy(one) || !this.cases.some(({ id }) => id === one.id)) return void this.refresh();
    const put = (cases: readonly Case[]): readonly Case[] => cases.map((old) => (old.id === one.id ? one : old));
    this.#newest = put(this.#newest);
    this.#older = put(this.#older);
    this.#merge();
  }

  /** Whether the server has no case at all. */
  get isEmpty(): boolean {
    return this.#isListed && this.cases.length === 0;
  }

  /** The id of the only case there is; null where there is none, or more. */
  get only(): string | null {
    return this.cases.length === 1 && !this.#next ? (this.cases[0]?.id ?? null) : null;
  }

  /** Takes a case that was deleted away. */
  forget(id: string): void {
    this.#newest = this.#newest.filter((one) => one.id !== id);
    this.#older = this.#older.filter((one) => one.id !== id);
    this.#merge();
  }

  /** Points out a case, until it is chosen. */
  flag(id: string, why: string): void {
    if (id === this.#marked) return;
    const isReady = this.cases.some((one) => one.id === id && one.state === "ready");
    this.#flagged.set(id, { why, isReady });
    this.#draw();
    this.#reach(this.#wanted.findIndex((one) => one.id === id));
  }

  /** Marks the case that is shown. */
  mark(id: string | null): void {
    this.#marked = id;
    if (id) this.#flagged.delete(id);
    this.#place();
  }

  dispose(): void {
    this.#disposed = true;
    this.#progress.dispose();
    this.#resized.disconnect();
    cancelAnimationFrame(this.#frame);
    clearTimeout(this.#timer);
    clearTimeout(this.#look);
    document.removeEventListener("visibilitychange", this.#onVisible);
  }

  #say(words: string): void {
    tell(this.#note, words);
  }

  #merge(): void {
    const fresh = new Set(this.#newest.map((one) => one.id));
    this.cases = [...this.#newest, ...this.#older.filter((one) => !fresh.has(one.id))];
    this.#say(this.cases.length === 0 ? t("cases.none") : "");
    this.#draw();
    const busy = this.cases.filter(isBusy);
    this.#progress.follow((busy.find(({ state }) => state === "preparing") ?? busy.at(-1))?.id ?? null);
    this.#listener.changed();
  }

  /** Asks for all that is older, once. */
  async #loadOlder(): Promise<void> {
    if (this.#isLoadingOlder) return;
    this.#isLoadingOlder = true;
    try {
      while (this.#next && this.cases.length < MOST_CASES && !this.#disposed) {
        const page = await listCases(this.#next, PAGE_CASES);
        this.#older = [...this.#older, ...page.cases];
        this.#next = page.next ?? null;
        this.#merge();
      }
    } catch (problem) {
      this.#say(troubleWords(problem));
    }
    this.#isLoadingOlder = false;
  }

  #draw(): void {
    const present = new Set(this.cases.map((one) => one.id));
    for (const id of this.#rows.keys()) if (!present.has(id)) this.#rows.delete(id);
    const order = ORDERS.find((one) => one === this.#order.value) ?? "newest";
    const search = this.#search.value.trim();
    this.#wanted = sorted(this.cases, order).filter((one) => matches(one, search));
    this.#titled = alike(this.cases);
    if (this.cases.length > 0) this.#say(this.#wanted.length === 0 ? t("cases.no-match") : "");
    this.#place();
    for (const one of this.cases) {
      const flag = this.#flagged.get(one.id);
      if (!flag || flag.isReady || one.state !== "ready") continue;
      flag.isReady = true;
      this.#listener.ready(one);
    }
  }

  /** Other cases are looked for, or in another order. */
  #fromTop(): void {
    this.#scroller.scrollTop = 0;
    this.#draw();
  }

  // -- The rows in sight

  #stir(): void {
    this.#frame ||= requestAnimationFrame(() => {
      this.#frame = 0;
      this.#place();
    });
  }

  /** Puts the rows in sight into the list, and with them the open case and the row that has the focus. */
  #place(): void {
    const count = this.#wanted.length;
    const [first, end] = rowsInSight(count, this.#scroller.scrollTop, this.#scroller.clientHeight);
    const focused = this.#focusedId;
    const kept = this.#wanted.flatMap(({ id }, at) => (id === this.#marked || id === focused ? [at] : []));
    const above = kept.filter((at) => at < first);
    const below = kept.filter((at) => at >= end);
    const inSight = Array.from({ length: end - first }, (_, at) => first + at);
    const elements = [...above, ...inSight, ...below].map((at) => this.#row(at, count).element);
    this.#swap(elements);
    this.#list.style.paddingTop = `${(first - above.length) * ROW_PIXELS}px`;
    this.#list.style.paddingBottom = `${(count - end - below.length) * ROW_PIXELS}px`;
    const [open, { scrollTop, clientHeight }] = [this.#openAt, this.#scroller];
    for (const at of inSight) {
      const isHidden = this.#wanted[at]?.id !== focused && isCovered(at, open, scrollTop, clientHeight);
      this.#rows.get(this.#wanted[at]?.id ?? "")?.conceal(isHidden);
    }
    clearTimeout(this.#look);
    this.#look = window.setTimeout(() => {
      for (const at of inSight) this.#rows.get(this.#wanted[at]?.id ?? "")?.look();
    }, LOOK_MS);
  }

  /** Where the open case is in the list; -1: nowhere. */
  get #openAt(): number {
    return this.#wanted.findIndex(({ id }) => id === this.#marked);
  }

  /** The case of the row that has the focus. */
  get #focusedId(): string | undefined {
    return document.activeElement?.closest<HTMLElement>("#case-list li")?.dataset.id;
  }

  /** Rows that stay are not taken out, so that the focus stays as well. */
  #swap(elements: readonly HTMLElement[]): void {
    const stay = new Set<Element>(elements);
    for (const old of [...this.#list.children]) if (!stay.has(old)) old.remove();
    elements.forEach((element, at) => {
      if (this.#list.children[at] !== element) this.#list.insertBefore(element, this.#list.children[at] ?? null);
    });
  }

  #row(at: number, count: number): Row {
    const one = this.#wanted[at] as Case;
    const row = this.#rows.get(one.id) ?? new Row(one, (doomed) => this.#listener.remove(doomed));
    this.#rows.set(one.id, row);
    row.show(one, this.#titled.get(shortTitle(one)) ?? []);
    row.place(at, count);
    row.mark(one.id === this.#marked);
    row.flag(this.#flagged.get(one.id)?.why ?? "");
    return row;
  }

  /** Scrolls until a row is in sight. */
  #reach(at: number): void {
    if (at < 0) return;
    this.#scroller.scrollTop = scrolledTo(at, this.#openAt, this.#scroller.scrollTop, this.#scroller.clientHeight);
    this.#place();
  }

  /** Arrows go from case to case. */
  #walk(event: KeyboardEvent): void {
    if (event.ctrlKey || event.metaKey || event.altKey) return;
    const last = this.#wanted.length - 1;
    const at = this.#wanted.findIndex((one) => one.id === this.#focusedId);
    const page = Math.max(Math.floor(this.#scroller.clientHeight / ROW_PIXELS) - 1, 1);
    const to = { ArrowDown: at + 1, ArrowUp: at - 1, PageDown: at + page, PageUp: at - page, Home: 0, End: last }[
      event.key
    ];
    if (to === undefined || at < 0) return;
    event.preventDefault();
    const next = Math.min(Math.max(to, 0), last);
    this.#reach(next);
    this.#rows.get(this.#wanted[next]?.id ?? "")?.focus();
  }
}
