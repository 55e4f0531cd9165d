// The cases of the server: filtered, sorted and paged by it. The pages in sight are here, and kept fresh by asking; the server tells how
// far a case is.

import { batch, computed, effect, signal } from "@preact/signals";

import { searchCases } from "../base/api.ts";
import { caseTitle } from "../base/case-words.ts";
import { t } from "../base/i18n.ts";
import { troubleWords } from "../base/problem-words.ts";
import { Progress } from "../base/progress.ts";
import type { Case, Listed } from "../model/case.ts";
import { ALL, type Filter, searchBody } from "../model/worklist.ts";
import { announce } from "./announce.ts";

const IDLE_MS = 4000;
/** While more cases are being prepared than are followed. */
const BUSY_MS = 1000;
const PAGE_CASES = 50;
/** So long after the last letter the server is asked. */
const TYPED_MS = 300;

type Pages = ReadonlyMap<number, readonly Listed[]>;

const isBusy = (one: Case): boolean => one.state === "queued" || one.state === "preparing";

export class Cases {
  readonly filter = signal(ALL);
  readonly open = signal<string | null>(null);
  /** Those to be pointed out until they are opened, the latest at the end, and why. */
  readonly flags = signal<ReadonlyMap<string, string>>(new Map());
  /** Whether the server has said which cases there are. */
  readonly isListed = signal(false);
  /** How many cases the filter leaves. */
  readonly total = signal(0);
  /** The case that was chosen from a list last. */
  chosen: string | null = null;
  readonly #pages = signal<Pages>(new Map());
  readonly #trouble = signal("");
  /** The cases that are here. */
  readonly here = computed(() => [...this.#pages.value.values()].flat());
  /** Whether the server has answered for the filter as it is now. */
  readonly #isKnown = computed(() => this.isListed.value && this.#of.value === this.filter.value);
  /** Whether there is no case at all. */
  readonly isEmpty = computed(() => this.#isKnown.value && this.total.value === 0 && this.filter.value === ALL);
  /** What there is to say of the list; empty: it speaks for itself. */
  readonly note = computed(() => {
    if (this.#trouble.value) return this.#trouble.value;
    if (this.total.value > 0) return "";
    if (!this.#isKnown.value) return t("cases.asking");
    return t(this.isEmpty.value ? "cases.none" : "cases.no-match");
  });
  readonly #progress = new Progress((one) => this.#hear(one));
  /** The filter of the pages. */
  readonly #of = signal(ALL);
  /** From the first to before the last row in sight. */
  #sight: readonly [number, number] = [0, 1];
  /** Pages that are asked for again, though they are here. */
  #stale = new Set<number>();
  #loading: Promise<void> | null = null;
  #timer = 0;
  /** Cases that are pointed out and cannot be shown yet. */
  readonly #awaited = new Set<string>();

  constructor() {
    document.addEventListener("visibilitychange", () => {
      if (!document.hidden) void this.refresh();
    });
    effect(() => {
      const busy = this.here.value.filter(isBusy);
      this.#progress.follow((busy.find(({ state }) => state === "preparing") ?? busy.at(-1))?.id ?? null);
      for (const one of this.here.value) {
        if (one.state !== "ready" || !this.#awaited.delete(one.id)) continue;
        announce(t("case.now-ready", { title: caseTitle(one) }));
      }
    });
  }

  /** The case in a row; null while it is on its way. */
  at(row: number): Listed | null {
    return this.#pages.value.get(Math.floor(row / PAGE_CASES))?.[row % PAGE_CASES] ?? null;
  }

  /** The row of a case that is here; -1: it is not. */
  rowOf(id: string | null): number {
    for (const [page, cases] of this.#pages.value) {
      const at = cases.findIndex((one) => one.id === id);
      if (at >= 0) return page * PAGE_CASES + at;
    }
    return -1;
  }

  /** Hears which rows are in sight, from the first to before the last, and fetches those that are not here. */
  see(first: number, end: number): void {
    this.#sight = [first, end];
    void this.#load();
  }

  /** Changes the filter; what is typed is looked for after a while. */
  choose(change: Partial<Filter>): void {
    const before = this.filter.peek();
    const after = { ...before, ...change };
    if ((Object.keys(ALL) as (keyof Filter)[]).every((key) => after[key] === before[key])) return;
    const isAll = (Object.keys(ALL) as (keyof Filter)[]).every((key) => after[key] === ALL[key]);
    this.filter.value = isAll ? ALL : after;
    clearTimeout(this.#timer);
    this.#timer = window.setTimeout(() => void this.refresh(), change.text === undefined ? 0 : TYPED_MS);
  }

  /** Asks for the pages in sight now, and again after a while. */
  async refresh(): Promise<void> {
    clearTimeout(this.#timer);
    for (const page of this.#inSight()) this.#stale.add(page);
    await this.#load();
    clearTimeout(this.#timer);
    if (document.hidden) return;
    const isMore = this.here.peek().filter(isBusy).length > (this.#progress.isShared ? 1 : 0);
    this.#timer = window.setTimeout(() => void this.refresh(), isMore ? BUSY_MS : IDLE_MS);
  }

  /** The id of the only case there is; null where there is none, or more. */
  get only(): string | null {
    return this.filter.peek() === ALL && this.total.peek() === 1 ? (this.here.peek()[0]?.id ?? null) : null;
  }

  /** Points out a case, until it is opened. */
  flag(id: string, why: string): void {
    if (id === this.open.peek()) return;
    this.flags.value = new Map([...this.#flagsBut(id), [id, why]]);
    if (!this.here.peek().some((one) => one.id === id && one.state === "ready")) this.#awaited.add(id);
  }

  show(id: string | null): void {
    this.open.value = id;
    if (id && this.flags.peek().has(id)) this.flags.value = new Map(this.#flagsBut(id));
  }

  #flagsBut(id: string): readonly (readonly [string, string])[] {
    return [...this.flags.peek()].filter(([one]) => one !== id);
  }

  #hear(one: Case): void {
    // What the list does not hold yet comes with all that is new.
    if (!isBusy(one) || this.rowOf(one.id) < 0) return void this.refresh();
    const put = (old: Listed): Listed => (old.id === one.id ? { ...old, ...one } : old);
    this.#pages.value = new Map([...this.#pages.peek()].map(([page, cases]) => [page, cases.map(put)]));
  }

  #inSight(): readonly number[] {
    const [first, end] = this.#sight;
    const page = Math.floor(first / PAGE_CASES);
    return Array.from({ length: Math.max(Math.ceil(end / PAGE_CASES) - page, 1) }, (_, at) => page + at);
  }

  /** The next page in sight that is not here, or not fresh. */
  get #wanted(): number | undefined {
    return this.#inSight().find((page) => this.#stale.has(page) || !this.#pages.peek().has(page));
  }

  /** Fetches, one after the other, the pages in sight: those that were scrolled past are not asked for. */
  async #load(): Promise<void> {
    if (this.#wanted !== undefined) await (this.#loading ??= this.#loadAll());
  }

  async #loadAll(): Promise<void> {
    try {
      for (let page = this.#wanted; page !== undefined; page = this.#wanted) {
        this.#stale.delete(page);
        await this.#ask(page);
      }
      this.#trouble.value = "";
    } catch (problem) {
      this.#trouble.value = troubleWords(problem);
    } finally {
      this.#loading = null;
    }
  }

  async #ask(page: number): Promise<void> {
    const filter = this.filter.peek();
    const { cases, total } = await searchCases(searchBody(filter, Date.now()), page * PAGE_CASES, PAGE_CASES);
    // Another filter may have been chosen in the meantime.
    if (filter !== this.filter.peek()) return void this.#stale.add(page);
    // Other pages have moved, or are of another filter: they are asked for when they are seen.
    const seen = filter === this.#of.peek() ? this.#inSight() : [];
    batch(() => {
      this.#of.value = filter;
      const kept = [...this.#pages.peek()].filter(([one]) => one !== page && seen.includes(one));
      this.#pages.value = new Map([...kept, [page, cases]]);
      this.total.value = total;
      this.isListed.value = true;
    });
  }
}
