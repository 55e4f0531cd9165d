// What keys and buttons ask for, done to the store: one table for all of them.

import { number, t } from "../base/i18n.ts";
import { positionWords } from "../base/readout.ts";
import { changeOf, laidOut, otherSide } from "../model/commands.ts";
import type { ChangingCommand, Command, LayerCommand } from "../model/controls.ts";
import { findingAt } from "../model/findings.ts";
import { nextOf } from "../model/layers.ts";
import type { MapName } from "../model/maps.ts";
import { PLANE_NAMES, type Vec2 } from "../model/space.ts";
import { type Layout, type ViewState, hasSlices, isMirrored } from "../model/state.ts";
import { announce, note } from "./announce.ts";
import { goToRow, showEvidence } from "./bring.ts";
import { mayWrite } from "./holder.ts";
import { recallLayout } from "./saved-layouts.ts";
import { walk } from "./steps.ts";
import type { Store } from "./store.ts";

type Work<Kind extends Command["kind"]> = (store: Store, command: Command & { readonly kind: Kind }) => unknown;

const ofLayers = ({ layers }: Store, command: LayerCommand): void => layers.command(command);

const COMMANDS: { readonly [Kind in Command["kind"]]: Work<Kind> } = {
  play: ({ sweep }) => (sweep.isRunning.peek() ? sweep.stop() : sweep.start()),
  timer: ({ hasTimer }) => (hasTimer.value = !hasTimer.peek()),
  outline: ({ outlined, view }) => {
    const where = view.now.layout === "closer" ? "closer" : "slices";
    const isShown = !outlined.peek()[where];
    outlined.value = { ...outlined.peek(), [where]: isShown };
    announce(t(isShown ? "outline.shown" : "outline.hidden"));
  },
  hold: ({ isBare, layers }) => {
    isBare.value = true;
    layers.hide(true);
  },
  release: ({ isBare, layers }) => {
    isBare.value = false;
    layers.hide(false);
  },
  closer: (store) => (store.view.now.layout === "closer" ? leaveCloser(store) : lookCloser(store)),
  across: (store) => {
    const { across_deg, layout } = store.view.now;
    showAcross(store, across_deg === null || !hasSlices({ layout }) ? (across_deg ?? 0) : null);
  },
  "flat-map": (store) => {
    const { layout, map } = store.view.now;
    if (layout !== "map") return setLayout(store, "map");
    store.view.change({ map: { ...map, has_inner: !map.has_inner } }, true);
    announce(t(map.has_inner ? "flat-map.outer-shown" : "flat-map.inner-shown"));
  },
  row: async (store, { steps }) => {
    store.task.value = "read";
    const { crosshair_mm } = store.view.now;
    const row = await store.rows.next(steps);
    // The places may come when something else is marked.
    if (store.isOver || store.view.now.crosshair_mm !== crosshair_mm) return;
    if (typeof row === "string") note(row);
    else goToRow(store, row);
  },
  step: (store, { steps }) => walk(store, steps),
  judge: (store, { judgement }) => {
    if (!mayWrite.peek()) return note(t("findings.read-only"));
    store.task.value = "read";
    const { rows, findings, view } = store;
    const { crosshair_mm: mark } = view.now;
    const open = rows.open.peek()?.finding;
    const isHere = mark && open && findingAt([open], mark);
    const { list, place, finding: known } = (isHere ? rows.open.peek() : rows.marked.peek()) ?? {};
    const finding = known ?? (mark && findingAt(findings.list.peek(), mark));
    if (list && place && !known) findings.judge(place, judgement, list.map);
    else if (finding) findings.rule(finding, judgement);
    else if (judgement === "kept") findings.add();
    else note(t("findings.none-here"));
  },
  leave: (store) => {
    const { layout, across_deg } = store.view.now;
    if (store.large.peek() !== null) store.large.value = null;
    else if (store.isAlone.peek()) store.isAlone.value = false;
    else if (layout === "closer") leaveCloser(store);
    else if (across_deg !== null) showAcross(store, null);
  },
  alone: ({ isAlone }) => {
    isAlone.value = !isAlone.peek();
    if (isAlone.peek()) note(t("alone.said"));
  },
  patient: () => document.body.classList.toggle("no-patient"),
  layouts: () => announce(t("layouts.await")),
  recall: (store, { number }) => recallLayout(store, number),
  ruler: (store) => {
    store.task.value = "read";
    store.measures.toggle();
  },
  mark: (store) => {
    const [width, height] = store.size;
    const middle: Vec2 = [width / 2, height / 2];
    if (!store.tool) return pick(store, middle);
    const picked = store.surface?.pick(store.view.now, ...middle);
    if (picked) store.tool.add(picked.position_in_patient, "surface");
    else store.miss(t("point.none"));
  },
  depth: change,
  turn: change,
  pan: change,
  zoom: change,
  view: change,
  window: change,
  map: (store, command) => {
    const isShown = store.view.seen.peek().overlay?.name === command.name;
    const reason = isShown ? "" : store.caseLayers.whyNone(command.name);
    if (reason) return note(reason);
    change(store, command);
    if (store.view.seen.peek().overlay?.name === command.name) void notePlaces(store, command.name);
  },
  surface: change,
  invert: change,
  reset: change,
  grey: ofLayers,
  colours: ofLayers,
  swipe: ofLayers,
  edges: ofLayers,
  beside: ofLayers,
  swap: ofLayers,
  nudge: (store, command) => {
    store.task.value = "images";
    ofLayers(store, command);
  },
  series: ({ layers, view }, { id, pane = view.pane.peek() }) =>
    id === undefined ? layers.nextSeries(pane) : layers.showSeries(id, pane),
  alike: ({ layers }) => layers.alike(),
  strip: ({ hasStrip, isStripShown }) => (hasStrip.value = !isStripShown.peek()),
  plane: (store, { plane: wanted }) => {
    const { view, large } = store;
    if (!hasSlices(view.now)) showSlices(store);
    const plane = wanted === undefined ? nextOf(PLANE_NAMES, view.now.plane) : wanted === "three" ? null : wanted;
    large.value = null;
    view.change({ plane }, true);
    note(plane ? t("plane.said", { plane: t(`plane.${plane}`) }) : t("plane.three-said"));
  },
  cine: (store, { plane }) => {
    const { view, cine } = store;
    const isCloser = view.now.layout === "closer";
    if (!hasSlices(view.now) && !isCloser) showSlices(store);
    store.sweep.stop();
    cine.toggle(plane ?? (isCloser ? null : view.now.plane) ?? view.slice.peek());
    announce(t(cine.plane.peek() ? "cine.begun" : "cine.ended"));
  },
  // The page's own.
  help: () => {},
  undo: (store) => (store.goTo("undo") ? announce(t("done.undo")) : note(t("none.undo"))),
  redo: (store) => (store.goTo("redo") ? announce(t("done.redo")) : note(t("none.redo"))),
};

/** Does again what was asked for before the case was loaded. */
export function catchUp(store: Store): void {
  const { wanted } = store;
  store.wanted = null;
  if (wanted) pick(store, wanted.place, wanted.state);
}

/** Does what a key that no control has taken asks for, or a button. */
export function perform(store: Store, command: Command): void {
  (COMMANDS[command.kind] as Work<Command["kind"]>)(store, command);
}

/** Says how many places of a map stand out, and on which side: the picture may show the other one. */
async function notePlaces(store: Store, name: MapName): Promise<void> {
  const { places } = store;
  const list = places.lists.find(({ map }) => map === name);
  const found = list && (await places.standingOut(list).catch(() => null));
  // Another map may be shown by now.
  if (!found || store.isOver || store.view.seen.peek().overlay?.name !== name) return;
  const count = (side: "left" | "right" | "middle"): string =>
    number(found.filter((place) => place.side === side).length);
  note(t("map.stand-out", { left: count("left"), right: count("right"), middle: count("middle") }));
}

/** Changes the view, and nothing else. */
function change(store: Store, command: ChangingCommand): void {
  const { view } = store;
  if (command.kind === "depth" || command.kind === "reset") store.sweep.stop();
  if (command.kind === "reset") {
    store.point.picked = null;
    store.centred.value += 1;
  }
  const { change: made, isStep } = changeOf(command, view.seen.peek(), store.shown, store.size);
  const isOfLook = command.kind === "window" || command.kind === "map" || command.kind === "invert";
  if (isOfLook) view.changeLook(made, isStep);
  else view.change(made, isStep);
  if (command.kind === "surface") announce(t(`surface.${view.now.surface}-said`));
  if (command.kind === "view") announce(t(`view.${command.name}`));
  if (command.kind === "window") announce(t("window.said", { name: t(`window.${command.preset}`) }));
}

export function setLayout(store: Store, layout: Layout): void {
  store.large.value = null;
  if (layout === "closer") return lookCloser(store);
  store.view.change(laidOut(layout, store.view.now, store.shown), true);
  announce(t(`layout.${layout}`));
  store.looks.value += 1;
}

/** Shows slices beside what is shown. */
const showSlices = (store: Store): void => setLayout(store, isMirrored(store.view.now) ? "both" : "slices");

/** Shows the close-up of the marked place. */
function lookCloser(store: Store): void {
  const { layout, beside, crosshair_mm } = store.view.now;
  if (layout === "closer") return;
  if (!crosshair_mm) return store.miss(t("closer.unmarked"));
  store.beforeCloser = { layout, beside };
  store.view.change({ layout: "closer" }, true);
  showEvidence(store);
  announce(t("layout.closer"));
  store.looks.value += 1;
}

/** Shows what was shown before the close-up. */
function leaveCloser({ view, beforeCloser }: Store): void {
  view.change(beforeCloser, true);
  announce(t(`layout.${beforeCloser.layout}`));
}

/** Shows the slice across the sulcus at the mark, turned by so much, or takes it away. */
export function showAcross(store: Store, across_deg: number | null): void {
  const { layout, crosshair_mm } = store.view.now;
  if (across_deg !== null && !crosshair_mm) return store.miss(t("across.unmarked"));
  store.large.value = null;
  const { beforeAcross } = store;
  store.beforeAcross = across_deg !== null && !hasSlices({ layout }) ? layout : null;
  const others = hasSlices({ layout })
    ? {}
    : laidOut(layout === "mirror" ? "both" : "slices", store.view.now, store.shown);
  const back = beforeAcross ? { layout: beforeAcross } : {};
  store.view.change({ across_deg, ...(across_deg === null ? back : others) }, true);
  announce(t(across_deg === null ? "across.hidden" : "across.shown"));
  if (across_deg !== null) store.looks.value += 1;
}

/** Puts the cross where the surface is seen at a place of the pane. */
export function pick(store: Store, place: Vec2, state: ViewState = store.view.now): void {
  const { surface, point } = store;
  const picked = surface?.pick(state, ...place);
  if (!picked) {
    const isKnown = (surface?.probe(store.shown.envelope_sphere.center_in_patient) ?? null) !== null;
    // Until the depths are here nothing knows where the surface is.
    const isLoading = !store.isLoaded.peek();
    if (isLoading && !isKnown) store.wanted = { place, state };
    return store.miss(t(isKnown ? "point.none" : isLoading ? "point.loading" : "point.unknown"));
  }
  // The marked hemisphere is the one that is shown as it was acquired.
  const turned = picked.isFlipped ? otherSide(state, store.shown) : {};
  point.picked = { ...picked, surface: turned.surface ?? state.surface };
  store.view.change({ ...turned, crosshair_mm: picked.position_in_patient }, true);
  announce(t("point.said", { position: positionWords(picked.position_in_patient) }));
}
