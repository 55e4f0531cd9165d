// What a named user has chosen and saved: the server keeps it for them in whatever browser they sit; the browser has a copy.

import { batch, effect, signal, untracked } from "@preact/signals";

import { Problem, getHolder } from "../base/api.ts";
import { t } from "../base/i18n.ts";
import { own } from "../base/kept.ts";
import { problemWords } from "../base/problem-words.ts";
import { type SavedLayout, readLayouts } from "../model/saved-layouts.ts";
import { note } from "./announce.ts";
import { holder, isNamed } from "./holder.ts";
import { arranged, choicesOf, choose, preferences, readPreferences } from "./preferences.ts";
import { ownSteps, savedLayouts, takeLayouts, takeSteps } from "./saved-layouts.ts";
import { type Stored, Sync } from "./sync.ts";

type Members = Readonly<Record<string, unknown>>;

/** A document as the server has it: what is absent was never kept, and a later page may keep more. */
interface Document extends Members {
  readonly choices?: Members;
  readonly layouts?: readonly SavedLayout[];
  /** They come one after the other, so they are one choice. */
  readonly steps?: readonly SavedLayout[];
}

const chosen = () => ({ choices: choicesOf(preferences.value), layouts: savedLayouts.value, steps: ownSteps.value });

const text = (value: unknown): string => JSON.stringify(value) ?? "";

/** What has changed here since `base`, in what is there. */
function joined(base: Members = {}, here: Members = {}, there: Members = {}): Members {
  const changed = Object.keys({ ...base, ...here }).filter((key) => text(here[key]) !== text(base[key]));
  return { ...there, ...Object.fromEntries(changed.map((key) => [key, here[key]])) };
}

/** Layouts by name; a number would change their order. */
const byName = (layouts: readonly SavedLayout[] = []): Members =>
  Object.fromEntries(layouts.map((one) => [`name ${one.name}`, one]));

class Person extends Sync<Document> {
  /** Why the server does not keep what was changed. */
  readonly trouble = signal("");
  readonly #name: string;
  /** Whether somebody else has signed in since. */
  #isOver = false;

  constructor(name: string) {
    super("v1/preferences", {});
    this.#name = name;
  }

  protected override get isOpen(): boolean {
    return !this.#isOver;
  }

  protected areSame(one: Document, other: Document): boolean {
    return text(one) === text(other);
  }

  protected bodyOf(value: Document): Document {
    return value;
  }

  protected valueOf(answer: unknown): Document {
    const isList = (key: string): boolean => key === "layouts" || key === "steps";
    const members = Object.entries(answer as Members);
    return Object.fromEntries(members.map(([key, value]) => [key, isList(key) ? readLayouts(value) : value]));
  }

  protected joined(base: Document, here: Document, there: Document): Document {
    const all: Document = joined(base, here, there);
    const layouts = Object.values(joined(byName(base.layouts), byName(here.layouts), byName(there.layouts)));
    return {
      ...all,
      ...(all.choices && { choices: joined(base.choices, here.choices, there.choices) }),
      ...(all.layouts && { layouts: layouts.filter(Boolean) as SavedLayout[] }),
    };
  }

  protected override adopt(stored: Stored<Document>): void {
    const before = this.value.peek();
    super.adopt(stored);
    if (this.isRead.peek() && !this.areSame(before, this.value.peek())) this.show();
  }

  protected override async read(): Promise<void> {
    const isAgain = this.isRead.peek();
    this.#isOver ||= isAgain && (await getHolder()).name !== this.#name;
    if (!this.#isOver) return super.read();
    this.trouble.value = t("choices.of-another");
  }

  protected override async put(body: string | Blob): Promise<Stored<Document>> {
    try {
      const stored = await super.put(body);
      this.trouble.value = "";
      return stored;
    } catch (problem) {
      // A change of another window is joined.
      if (!(problem instanceof Problem && problem.status === 412)) {
        this.trouble.value = t("choices.unsaved", { why: problemWords(problem) });
      }
      throw problem;
    }
  }

  /** Shows in the page what was kept. */
  show(): void {
    const { choices, layouts, steps } = this.value.peek();
    batch(() => {
      const now = preferences.peek();
      if (choices) choose(readPreferences({ ...now, ...choices, ...arranged(now) }));
      if (layouts) takeLayouts(layouts);
      if (steps) takeSteps(steps);
    });
  }

  /** Keeps what changes in the page from now on. */
  follow(): void {
    let before = chosen();
    effect(() => {
      const now = chosen();
      const parts = (Object.keys(now) as (keyof typeof now)[]).filter((part) => text(now[part]) !== text(before[part]));
      before = now;
      if (parts.length === 0) return;
      const here = this.value.peek();
      const all = { ...now, choices: { ...here.choices, ...now.choices } };
      this.change({ ...here, ...Object.fromEntries(parts.map((part) => [part, all[part]])) });
    });
    effect(() => {
      if (this.trouble.value !== "") note(this.trouble.value);
    });
    document.addEventListener("visibilitychange", () => {
      // The page may be left at once.
      if (document.hidden) void this.flush().catch(() => {});
    });
  }
}

let person: Person | null = null;

/** Makes the copy of the browser that of somebody: what another person has chosen is not theirs. What nobody in particular has is, but for a name. */
function takeCopy(name: string): void {
  const before = own(name);
  const isOthers = before !== "" && before !== name;
  choose(isOthers ? readPreferences(null) : before === name ? {} : { reader: "" });
  takeLayouts(isOthers ? [] : savedLayouts.peek());
  takeSteps(isOthers ? [] : ownSteps.peek());
}

/** The choices that are others than before. */
const chosenSince = (before: Members): Members =>
  Object.fromEntries(Object.entries(preferences.peek()).filter(([choice, value]) => value !== before[choice]));

function follow(begun: Person): void {
  person = begun;
  begun.follow();
}

/**
 * Takes over what the server keeps for whoever is signed in, and from then on keeps there what changes. What was chosen since `before`, while
 * the server was asked, counts.
 */
export async function followPerson(before: Members = { ...preferences.peek() }): Promise<void> {
  if (!holder.peek()) return;
  const { name } = (isNamed.peek() && holder.peek()) || { name: "" };
  const begun = name === "" ? null : new Person(name);
  const isRead = await begun?.load();
  const changed = chosenSince(before);
  batch(() => {
    // If it cannot be read, the browser has a copy.
    takeCopy(name);
    if (isRead) begun?.show();
  });
  if (begun && isRead) follow(begun);
  choose(changed);
  if (!begun || isRead) return;
  const copied = { ...preferences.peek() };
  const end = effect(() => {
    if (!begun.isRead.value) return;
    untracked(() => {
      const later = { ...changed, ...chosenSince(copied) };
      begun.show();
      follow(begun);
      choose(later);
    });
    queueMicrotask(() => end());
  });
}

/** Resolves once the server has what was changed by now, or cannot have it. */
export const isKept = async (): Promise<void> => person?.flush().catch(() => {});
