// The layouts that a reader has saved, and the steps that were made of some: in this browser, and on the server for a named user.

import { signal } from "@preact/signals";

import { isOwn, keep, keptText } from "../base/kept.ts";
import { type Key, number, t } from "../base/i18n.ts";
import {
  MOST_LAYOUTS,
  type SavedLayout,
  boundName,
  missingOf,
  readLayouts,
  recalled,
  savedAs,
} from "../model/saved-layouts.ts";
import { parsed } from "../model/text.ts";
import { announce, note } from "./announce.ts";
import { choose } from "./preferences.ts";
import type { Store } from "./store.ts";

/** Layouts that the browser keeps. */
function kept(name: string) {
  const stored = (): readonly SavedLayout[] => readLayouts(parsed(keptText("localStorage", name)));
  const layouts = signal(stored());
  // Another window has saved one.
  globalThis.addEventListener?.("storage", ({ key }: StorageEvent) => {
    if (key === name && isOwn()) layouts.value = stored();
  });
  return {
    layouts,
    take(now: readonly SavedLayout[]): void {
      layouts.value = now;
      if (isOwn()) keep("localStorage", name, now);
    },
  };
}

export const { layouts: savedLayouts, take: takeLayouts } = kept("isocortex-layouts");
/** One's own steps of a reading. */
export const { layouts: ownSteps, take: takeSteps } = kept("isocortex-steps");

export const layersOf = ({ caseLayers }: Store) => caseLayers.list.peek()?.layers ?? [];

/** Shows the layout of a number from 1. */
export function recallLayout(store: Store, at: number): void {
  const saved = savedLayouts.peek()[at - 1];
  if (!saved) return announce(t("layouts.none", { number: number(at) }));
  const { now } = store.view;
  // A close-up needs a mark, and comes with the panes as they are before it.
  if (saved.layout === "closer" && !now.crosshair_mm) return announce(t("closer.unmarked"));
  const layers = layersOf(store);
  store.large.value = null;
  if (!store.change(recalled(saved, now, store.shown, layers), true)) return;
  announce(t("layouts.shown", { name: saved.name }));
  const names = missingOf(saved, layers).map((one) =>
    one === "pet" || one === "ct" ? t(`layer.kind.${one}`) : t(`layer.contrast.${one}` as Key),
  );
  if (names.length > 0) note(t("strip.missing", { names: names.join(", ") }));
}

/** Saves the layout that is shown under a name; what there is to say about it. */
export function saveLayout(store: Store, typed: string): string {
  const name = boundName(typed);
  const layouts = savedLayouts.peek();
  const before = layouts.findIndex((one) => one.name === name);
  if (name === "") return t("layouts.unnamed");
  if (before < 0 && layouts.length >= MOST_LAYOUTS) return t("layouts.full");
  const saved = savedAs(name, store.view.now, layersOf(store));
  // Of the same name, in the same place.
  takeLayouts(before < 0 ? [...layouts, saved] : layouts.with(before, saved));
  return t("layouts.saved", { name });
}

export const removeLayout = (at: number): void => takeLayouts(savedLayouts.peek().toSpliced(at, 1));

/** Makes the saved layouts one's own steps; a close-up needs a mark, and is none. */
export function makeSteps(): string {
  const steps = savedLayouts.peek().filter(({ layout }) => layout !== "closer");
  if (steps.length === 0) return t("layouts.no-steps");
  takeSteps(steps);
  choose({ protocol: "own" });
  return t("layouts.steps-made", { count: number(steps.length) });
}

/** Layouts and steps as a file for others. */
export const layoutsFile = (): Blob =>
  new Blob([JSON.stringify({ layouts: savedLayouts.peek(), steps: ownSteps.peek() }, null, 2)], {
    type: "application/json",
  });

/** Adds the layouts of such a file, and takes its steps over; what there is to say about it. */
export function addLayouts(text: string): string {
  const file = parsed(text) as { readonly layouts?: unknown; readonly steps?: unknown } | null;
  const [given, steps] = [readLayouts(file?.layouts), readLayouts(file?.steps)];
  if (given.length + steps.length === 0) return t("layouts.unreadable");
  const names = new Set(given.map(({ name }) => name));
  const all = [...savedLayouts.peek().filter(({ name }) => !names.has(name)), ...given];
  if (all.length > MOST_LAYOUTS) return t("layouts.full");
  takeLayouts(all);
  if (steps.length > 0) takeSteps(steps);
  const said = (key: Key, { length }: readonly unknown[]): string =>
    length > 0 ? t(key, { count: number(length) }) : "";
  return `${said("layouts.added", given)} ${said("layouts.steps-added", steps)}`.trim();
}
