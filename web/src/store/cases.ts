// The cases of the server: kept fresh by asking, searched and sorted; the server tells how far a case is.

import { computed, effect, signal } from "@preact/signals";

import { findCases, listCases } from "../base/api.ts";
import { alike, caseFacts, caseTitle } from "../base/case-words.ts";
import { spoken, t } from "../base/i18n.ts";
import { troubleWords } from "../base/problem-words.ts";
import { Progress } from "../base/progress.ts";
import type { Case } from "../model/case.ts";
import { announce } from "./announce.ts";

const IDLE_MS = 4000;
/** While more cases are being prepared than are followed. */
const BUSY_MS = 1000;
/** So many cases are asked for together, behind the newest; and so many are listed at the most. */
const PAGE_CASES = 200;
const MOST_CASES = 10_000;
/** So long after the last letter the server is asked for cases that are not listed. */
const TYPED_MS = 300;

/** Whether a case is what the words look for: all in its name, date or state, or as the beginning of its id. */
export function matches(one: Case, search: string): boolean {
  const text = caseFacts(one).toLowerCase();
  return search
    .toLowerCase()
    .split(/\s+/)
    .every((word) => text.includes(word) || one.id.startsWith(word));
}

export const ORDERS = ["newest", "oldest", "label", "state"] as const;
export type Order = (typeof ORDERS)[number];

/** What asks for a look comes first. */
function rankOf(one: Case): number {
  if (one.state === "failed") return 0;
  if (one.state !== "ready") return 1;
  return (one.quality?.state ?? "ok") === "ok" ? 3 : 2;
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

export class Cases {
  readonly search = signal("");
  readonly order = signal<Order>("newest");
  readonly open = signal<string | null>(null);
  /** Those to be pointed out until they are opened, the latest at the end, and why. */
  readonly flags = signal<ReadonlyMap<string, string>>(new Map());
  /** Whether the server has said which cases there are. */
  readonly isListed = signal(false);
  /** The case that was chosen from a list last. */
  chosen: string | null = null;
  readonly #newest = signal<readonly Case[]>([]);
  readonly #older = signal<readonly Case[]>([]);
  /** Behind which the list goes on; null: it is whole. */
  readonly #next = signal<string | null>(null);
  /** Cases beyond those that are listed, found by their labels. */
  readonly #found = signal<readonly Case[]>([]);
  /** What the server was asked to find last, and has. */
  readonly #looked = signal("");
  readonly #trouble = signal("");
  readonly all = computed(() => {
    const fresh = new Set(this.#newest.value.map(({ id }) => id));
    return [...this.#newest.value, ...this.#older.value.filter(({ id }) => !fresh.has(id))];
  });
  /** The cases that are looked for, in their order. */
  readonly wanted = computed(() => {
    const listed = new Set(this.all.value.map(({ id }) => id));
    const all = [...this.all.value, ...this.#found.value.filter(({ id }) => !listed.has(id))];
    const search = this.search.value;
    const found = search === "" ? all : all.filter((one) => matches(one, search));
    return sorted(found, this.order.value);
  });
  /** Those that have the title of a case, by that title. */
  readonly alike = computed(() => alike(this.all.value));
  /** What there is to say of the list; empty: it speaks for itself. */
  readonly note = computed(() => {
    if (this.#trouble.value) return this.#trouble.value;
    if (!this.isListed.value) return t("cases.asking");
    if (this.all.value.length === 0) return t("cases.none");
    if (this.wanted.value.length > 0) return "";
    if (this.#next.value === null) return t("cases.no-match");
    // Of what is beyond the list, the server knows the labels alone.
    if (this.#looked.value !== this.search.value) return t("cases.looking");
    return t("cases.no-label", { number: this.all.value.length });
  });
  readonly #progress = new Progress((one) => this.#hear(one));
  #timer = 0;
  #isLoadingOlder = false;
  /** Cases that are pointed out and cannot be shown yet. */
  readonly #awaited = new Set<string>();

  constructor() {
    document.addEventListener("visibilitychange", () => {
      if (!document.hidden) void this.refresh();
    });
    effect(() => {
      const busy = this.all.value.filter(isBusy);
      this.#progress.follow((busy.find(({ state }) => state === "preparing") ?? busy.at(-1))?.id ?? null);
      for (const one of this.all.value) {
        if (one.state !== "ready" || !this.#awaited.delete(one.id)) continue;
        announce(t("case.now-ready", { title: caseTitle(one) }));
      }
    });
    // What is not listed yet, or is beyond what is listed, the server looks for.
    effect(() => {
      const label = this.search.value;
      if (label === "" || this.#next.value === null) return;
      const timer = setTimeout(() => void this.#find(label), TYPED_MS);
      return () => clearTimeout(timer);
    });
  }

  /** Asks for the newest cases now, and again after a while. */
  async refresh(): Promise<void> {
    clearTimeout(this.#timer);
    try {
      const { cases, next = null } = await listCases(null);
      if (this.#older.peek().length === 0) this.#next.value = next;
      this.#newest.value = cases;
      this.isListed.value = true;
      this.#trouble.value = "";
      void this.#loadOlder();
    } catch (problem) {
      this.#trouble.value = troubleWords(problem);
    }
    clearTimeout(this.#timer);
    if (document.hidden) return;
    const isMore = this.all.peek().filter(isBusy).length > (this.#progress.isShared ? 1 : 0);
    this.#timer = window.setTimeout(() => void this.refresh(), isMore ? BUSY_MS : IDLE_MS);
  }

  /** The id of the only case there is; null where there is none, or more. */
  get only(): string | null {
    const [one, another] = this.all.peek();
    return one && !another && !this.#next.peek() ? one.id : null;
  }

  /** Takes a case that was deleted away. */
  forget(id: string): void {
    const without = (cases: readonly Case[]): readonly Case[] => cases.filter((one) => one.id !== id);
    this.#newest.value = without(this.#newest.peek());
    this.#older.value = without(this.#older.peek());
    this.#found.value = without(this.#found.peek());
  }

  /** Points out a case, until it is opened. */
  flag(id: string, why: string): void {
    if (id === this.open.peek()) return;
    this.flags.value = new Map([...this.#flagsBut(id), [id, why]]);
    if (!this.all.peek().some((one) => one.id === id && one.state === "ready")) this.#awaited.add(id);
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
    if (!isBusy(one) || !this.all.peek().some(({ id }) => id === one.id)) return void this.refresh();
    const put = (cases: readonly Case[]): readonly Case[] => cases.map((old) => (old.id === one.id ? one : old));
    this.#newest.value = put(this.#newest.peek());
    this.#older.value = put(this.#older.peek());
  }

  /** Asks for all that is older, once. */
  async #loadOlder(): Promise<void> {
    if (this.#isLoadingOlder) return;
    this.#isLoadingOlder = true;
    try {
      for (let next = this.#next.peek(); next && this.all.peek().length < MOST_CASES; next = this.#next.peek()) {
        const page = await listCases(next, PAGE_CASES);
        this.#older.value = [...this.#older.peek(), ...page.cases];
        this.#next.value = page.next ?? null;
      }
    } catch (problem) {
      this.#trouble.value = troubleWords(problem);
    }
    this.#isLoadingOlder = false;
  }

  async #find(label: string): Promise<void> {
    try {
      const found = await findCases(label, PAGE_CASES);
      if (label === this.search.peek()) [this.#found.value, this.#looked.value] = [found, label];
    } catch (problem) {
      this.#trouble.value = troubleWords(problem);
    }
  }
}
