// The layouts that a reader has saved, in this browser.

import { signal } from "@preact/signals";

import { keep, keptText } from "../base/kept.ts";
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
import { announce, note } from "./announce.ts";
import type { Store } from "./store.ts";

const KEY = "isocortex-layouts";

const stored = (): readonly SavedLayout[] => readLayouts(keptText("localStorage", KEY));

export const savedLayouts = signal(stored());

// Another window has saved one.
globalThis.addEventListener?.("storage", ({ key }: StorageEvent) => {
  if (key === KEY) savedLayouts.value = stored();
});

const layersOf = ({ caseLayers }: Store) => caseLayers.list.peek()?.layers ?? [];

function take(layouts: readonly SavedLayout[]): void {
  savedLayouts.value = layouts;
  keep("localStorage", KEY, layouts);
}

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
  take(before < 0 ? [...layouts, saved] : layouts.with(before, saved));
  return t("layouts.saved", { name });
}

export const removeLayout = (at: number): void => take(savedLayouts.peek().toSpliced(at, 1));
