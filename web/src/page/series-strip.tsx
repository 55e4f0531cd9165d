// The strip of series: what the case has, to be dragged onto a pane, or chosen for the pane that a hand was in last.

import { t } from "../base/i18n.ts";
import { paneWords } from "../base/readout.ts";
import { keyOf } from "../model/keys.ts";
import { PLANE_NAMES } from "../model/space.ts";
import { type Place, hasSlices, lookAt, placeOf } from "../model/state.ts";
import { perform } from "../store/commands.ts";
import { seriesOf } from "../store/shown-layers.ts";
import type { Store } from "../store/store.ts";
import { Button, Choice, type OfStore } from "./fields.tsx";

/** What is dragged: the id of a series. */
const DRAGGED = "application/x-isocortex-series";

export function SeriesStrip({ store }: OfStore) {
  const { view, layers, isStripShown } = store;
  if (!isStripShown.value) return null;
  const state = view.state.value;
  const place = placeOf(state, view.pane.value);
  const shown = seriesOf(lookAt(state, place));
  const pane = paneWords(state, place);
  return (
    <div class="strip" role="group" aria-label={`${t("strip.label")}: ${pane}`}>
      <div class="chips">
        {layers.series.map(({ id, name }) => (
          <button
            key={id}
            type="button"
            class="chip"
            data-series={id}
            aria-pressed={id === shown}
            title={t("strip.hint")}
            draggable
            onDragStart={({ dataTransfer }) => {
              dataTransfer?.setData(DRAGGED, id);
              if (dataTransfer) dataTransfer.effectAllowed = "copy";
            }}
            onClick={() => perform(store, { kind: "series", id })}
          >
            {name}
          </button>
        ))}
      </div>
      <span class="quiet pane-words">{pane}</span>
      {Object.keys(state.panes).length > 0 && (
        <Button onClick={() => perform(store, { kind: "alike" })}>{t("strip.alike")}</Button>
      )}
      {hasSlices(state) && (
        <Choice
          id="planes"
          label={t("strip.planes.about")}
          title={keyOf(({ kind }) => kind === "plane")}
          values={["three", ...PLANE_NAMES]}
          value={state.plane ?? "three"}
          words={(plane) => t(plane === "three" ? "strip.three-planes" : `plane.${plane}`)}
          onChoose={(plane) => perform(store, { kind: "plane", plane })}
        />
      )}
    </div>
  );
}

/** Follows in which pane a hand or the focus is, and takes the series that are dropped on one. `placeAt` finds whose look is seen there. */
export function hearSeries(
  panes: HTMLElement,
  store: Store,
  placeAt: (pane: HTMLElement, event: Event) => Place,
): readonly (() => void)[] {
  const gone = new AbortController();
  const { signal } = gone;
  const placeOfEvent = (event: Event): Place | null => {
    const pane = event.target instanceof Element ? event.target.closest<HTMLElement>(".pane") : null;
    return pane && placeAt(pane, event);
  };
  const enter = (event: Event): void => {
    const place = placeOfEvent(event);
    if (place) store.view.pane.value = place;
    const { plane } = (event.target as HTMLElement).closest<HTMLElement>(".pane")?.dataset ?? {};
    store.view.slice.value = PLANE_NAMES.find((one) => one === plane) ?? store.view.slice.peek();
  };
  const over = (pane: Element | null): void => {
    for (const one of panes.querySelectorAll(".pane.taking")) one.classList.toggle("taking", one === pane);
    pane?.classList.add("taking");
  };
  const isSeries = (event: DragEvent): boolean => event.dataTransfer?.types.includes(DRAGGED) ?? false;
  panes.addEventListener("pointerdown", enter, { signal, capture: true });
  panes.addEventListener("focusin", enter, { signal });
  panes.addEventListener(
    "dragover",
    (event) => {
      if (!isSeries(event) || placeOfEvent(event) === null) return;
      event.preventDefault();
      over(event.target instanceof Element ? event.target.closest(".pane") : null);
    },
    { signal },
  );
  panes.addEventListener("dragleave", () => over(null), { signal });
  panes.addEventListener(
    "drop",
    (event) => {
      over(null);
      const pane = placeOfEvent(event);
      if (!isSeries(event) || pane === null) return;
      event.preventDefault();
      perform(store, { kind: "series", id: event.dataTransfer?.getData(DRAGGED) ?? "", pane });
      // Keys and chips go on with this pane.
      store.view.pane.value = pane;
    },
    { signal },
  );
  return [() => gone.abort()];
}
