// What a user chose once: of the page alone, never of a case.

import { signal } from "@preact/signals";

import { type Key, type Language, isLanguage, languageFor } from "../base/i18n.ts";
import { isOwn, keep, keptText } from "../base/kept.ts";
import { LONGEST_LABEL } from "../model/findings.ts";
import { type Protocol, isProtocol } from "../model/steps.ts";
import { parsed, plainLine } from "../model/text.ts";
import { DRAG_DIRECTIONS, type DragDirection, WHEEL_USES, type WheelUse } from "../model/controls.ts";

export const TASKS = ["read", "images", "case"] as const;
export type Task = (typeof TASKS)[number];

export const THEMES = ["dark", "light"] as const;

/** The sections of the panel that are unfolded at first. */
const UNFOLDED: readonly string[] = ["panel.list", "panel.reading", "panel.point", "panel.layers"] satisfies Key[];

export interface Preferences {
  readonly language: Language;
  readonly theme: (typeof THEMES)[number];
  readonly drag: DragDirection;
  readonly wheel: WheelUse;
  /** Whether single letters are commands. */
  readonly shortcuts: boolean;
  /** Whether the line that explains the depth slider was dismissed, or the depth was changed. */
  readonly knows_depth: boolean;
  /** Whether the slices of a case have one zoom. */
  readonly linked_zoom: boolean;
  /** Whether the list of cases is shown beside a picture. */
  readonly list: boolean;
  readonly panel: boolean;
  /** Whose sections the panel shows. */
  readonly task: Task;
  readonly unfolded: readonly string[];
  /** The steps of a reading. */
  readonly protocol: Protocol;
  /** Who reads: the author of new findings; empty: nobody has said. */
  readonly reader: string;
}

const KEY = "isocortex";

/** Sections that were two until they became the one list. */
const renamed = (one: string): string => (/^panel\.(maps|findings)$/.test(one) ? "panel.list" : one);

/** What is stored as preferences; whatever is not understood is as at first. */
export function readPreferences(
  kept: unknown,
  preferred: readonly string[] = globalThis.navigator?.languages ?? [],
): Preferences {
  // What another program has stored, or what is damaged, says nothing.
  const stored = (kept ?? {}) as Partial<Record<keyof Preferences, unknown>>;
  return {
    language: isLanguage(stored.language) ? stored.language : languageFor(preferred),
    theme: THEMES.find((one) => one === stored.theme) ?? "dark",
    drag: DRAG_DIRECTIONS.find((one) => one === stored.drag) ?? "up-darker",
    wheel: WHEEL_USES.find((one) => one === stored.wheel) ?? "zoom",
    shortcuts: stored.shortcuts !== false,
    knows_depth: stored.knows_depth === true,
    linked_zoom: stored.linked_zoom !== false,
    list: stored.list === true,
    panel: stored.panel !== false,
    task: TASKS.find((one) => one === stored.task) ?? "read",
    unfolded: Array.isArray(stored.unfolded)
      ? stored.unfolded.filter((one) => typeof one === "string").map(renamed)
      : UNFOLDED,
    protocol: isProtocol(stored.protocol) ? stored.protocol : "complete",
    reader: typeof stored.reader === "string" ? plainLine(stored.reader, LONGEST_LABEL) : "",
  };
}

export const preferences = signal(readPreferences(parsed(keptText("localStorage", KEY))));

/** How the page is arranged, which is this browser's. */
export const arranged = ({ list, panel, task, unfolded }: Preferences) => ({ list, panel, task, unfolded });

/** What is chosen wherever somebody sits. */
export function choicesOf({ list, panel, task, unfolded, ...choices }: Preferences) {
  return choices;
}

/** Takes a preference over; in a frame beside another case it is one of the frame alone. */
export function choose(change: Partial<Preferences>): void {
  preferences.value = { ...preferences.peek(), ...change };
  if (parent === window && isOwn()) keep("localStorage", KEY, preferences.peek());
}

/** Remembers that a section is unfolded, or folded. */
export function unfold(section: string, isOpen: boolean): void {
  const { unfolded } = preferences.peek();
  if (unfolded.includes(section) === isOpen) return;
  choose({ unfolded: isOpen ? [...unfolded, section] : unfolded.filter((one) => one !== section) });
}
