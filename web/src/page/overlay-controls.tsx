// How a layer lies over the picture: above which value, how opaque, in which colours from which value to which.

import { number, readNumber, t } from "../base/i18n.ts";
import { type LayerOverlay, OVERLAY_COLORMAPS, THRESHOLD_RANGE, isDiverging, isMap, styleOf } from "../model/maps.ts";
import { writer } from "../panes/map-bar.ts";
import { ChoiceLine, Line, type OfStore, Slider, Typed } from "./fields.tsx";

const NONE = { colormap: "hot" } as const;

/** The controls of what lies over the picture, among the maps or among the added layers. */
export function OverlayControls({ store, isOfMap }: OfStore & { readonly isOfMap: boolean }) {
  const { overlay: asked } = store.view.state.value;
  // Before a layer is described, nobody knows its range.
  const overlay = asked && !isMap(asked.name) ? store.layers.drawn.value.overlay : asked;
  if (!overlay || isMap(overlay.name) !== isOfMap) return null;
  const { threshold, opacity } = overlay;
  const style = styleOf(overlay);
  const isLabels = style.colormap === "labels";
  const [min = 0, max = 1, step = (max - min) / 100] = rangeOf(overlay);
  const set = (change: Partial<LayerOverlay>): void => {
    const { about: _, ...rest } = overlay;
    store.change({ overlay: { ...rest, ...change } });
  };
  const [low = 0, high = 1] = style.window;
  const end = (at: 0 | 1) => (
    <Typed
      class="end"
      inputMode="decimal"
      aria-label={t(at === 0 ? "map.low" : "map.high")}
      // Without the language's signs between thousands, which are commas or points.
      value={String(Number((style.window[at] ?? 0).toPrecision(5)))}
      onLeave={(typed) => {
        const window = [low, high].with(at, readNumber(typed)) as [number, number];
        if (window[0] < window[1]) set({ window });
      }}
    />
  );
  return (
    <div class="group-part">
      {!isLabels && !(isOfMap && threshold === null) && (
        <Slider
          id="map-threshold"
          label={t("map.threshold")}
          range={[min, max, step]}
          value={threshold ?? min}
          words={threshold === null ? t("map.all") : `${writer(style.window)(threshold)} ${style.unit}`}
          // Of an added layer, the lower end is no threshold.
          onSlide={(value) => set({ threshold: !isOfMap && value <= min ? null : value })}
        />
      )}
      <Slider
        id="map-opacity"
        label={t("map.opacity")}
        range={[0, 1, 0.05]}
        value={opacity}
        words={`${number(100 * opacity)} %`}
        onSlide={(value) => set({ opacity: value })}
      />
      {!isLabels && (
        <>
          <Line label={t("map.window")}>
            {end(0)}
            <span class="quiet">–</span>
            {end(1)}
          </Line>
          <ChoiceLine
            id="map-colours"
            label={t("colormap.label")}
            values={OVERLAY_COLORMAPS}
            value={style.colormap}
            words={(name) => t(`colormap.${name}`)}
            onChoose={(colormap) => set({ colormap })}
          />
        </>
      )}
    </div>
  );
}

/** The thresholds that can be chosen: of the maps a fixed range, of other layers their first window. */
function rangeOf({ name, about }: LayerOverlay): readonly number[] {
  const [low, high] = about?.window ?? THRESHOLD_RANGE;
  return isMap(name) ? [...THRESHOLD_RANGE, 0.1] : [Math.max(low, isDiverging(about ?? NONE) ? 0 : low), high];
}
