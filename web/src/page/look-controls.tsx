// How the volume and what lies over it are drawn: window and colours, the layer in colours, and the picture compared with the
// one without layers, by blinking, by a dividing line, by edges, side by side.

import { number, plainNumber, readNumber, t } from "../base/i18n.ts";
import type { Window } from "../model/case.ts";
import { type LayerCommand, boundWindow } from "../model/controls.ts";
import { type LayerOverlay, OVERLAY_COLORMAPS, THRESHOLD_RANGE, isDiverging, isMap, styleOf } from "../model/maps.ts";
import { COLORMAPS, WINDOW_PRESETS, allLayersOf, lookAt, presetWindow, textureOf } from "../model/state.ts";
import { writer } from "../panes/map-bar.ts";
import { perform } from "../store/commands.ts";
import { Button, Buttons, ChoiceLine, Line, type OfStore, Row, Slider, Typed } from "./fields.tsx";

export function WindowControls({ store }: OfStore) {
  const state = store.view.seen.value;
  const { window, colormap } = state;
  const texture = textureOf(state, store.shown);
  const isSame = (other: Window): boolean =>
    Math.abs(other.center - window.center) + Math.abs(other.width - window.width) < 1e-3 * window.width;
  const shown = WINDOW_PRESETS.find((preset) => isSame(boundWindow(presetWindow(preset, texture), texture)));
  return (
    <>
      <Buttons
        label={t("panel.window")}
        values={WINDOW_PRESETS}
        value={shown ?? null}
        words={(preset) => t(`window.${preset}`)}
        onChoose={(preset) => perform(store, { kind: "window", preset })}
      />
      <WindowPart store={store} part="center" />
      <WindowPart store={store} part="width" />
      <ChoiceLine
        id="colormap"
        label={t("colormap.label")}
        values={COLORMAPS}
        value={colormap}
        words={(name) => t(`colormap.${name}`)}
        onChoose={(name) => store.changeLook({ colormap: name }, true)}
      >
        <Button onClick={() => perform(store, { kind: "invert" })}>{t("invert")}</Button>
      </ChoiceLine>
    </>
  );
}

/** The level or the width, as a slider, which reaches as far as the values of the texture, and as a number in four figures. */
function WindowPart({ store, part }: OfStore & { readonly part: keyof Window }) {
  const { seen } = store.view;
  const { window } = seen.value;
  const texture = textureOf(seen.value, store.shown);
  const { min, max } = texture.intensity;
  const range = max - min || 1;
  const [low, high] = part === "center" ? [min + 0.5, max + 0.5] : [1 + range / 500, 1 + range];
  const label = t(`window.${part}`);
  const take = (value: number): void => {
    if (Number.isFinite(value) && (part === "center" || value >= 1))
      store.changeLook({ window: boundWindow({ ...seen.peek().window, [part]: value }, texture) });
  };
  const written = (): string => plainNumber(seen.peek().window[part], 4);
  return (
    <Line label={label}>
      <input
        type="range"
        id={`window-${part}`}
        aria-label={label}
        min={low}
        max={high}
        step={(high - low) / 500}
        value={window[part]}
        onInput={({ currentTarget }) => take(currentTarget.valueAsNumber)}
      />
      <Typed
        inputMode="decimal"
        id={`window-${part}-number`}
        aria-label={label}
        value={written()}
        onLeave={(typed) => {
          take(readNumber(typed));
          return written();
        }}
      />
    </Line>
  );
}

const NONE = { colormap: "hot" } as const;

/** The controls of what lies over the picture, among the maps or among the added layers. */
export function OverlayControls({ store, isOfMap }: OfStore & { readonly isOfMap: boolean }) {
  const { seen, place } = store.view;
  const { overlay: asked } = seen.value;
  // Before a layer is described, nobody knows its range.
  const overlay = asked && !isMap(asked.name) ? lookAt(store.layers.drawn.value, place.value).overlay : asked;
  if (!overlay || isMap(overlay.name) !== isOfMap) return null;
  const { threshold, opacity } = overlay;
  const style = styleOf(overlay);
  const isLabels = style.colormap === "labels";
  const [min = 0, max = 1, step = (max - min) / 100] = rangeOf(overlay);
  const set = (change: Partial<LayerOverlay>): void => {
    const { about: _, ...rest } = overlay;
    store.changeLook({ overlay: { ...rest, ...change } });
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

export function Comparison({ store }: OfStore) {
  const state = store.view.state.value;
  const { beside, swipe, has_edges, layout } = state;
  if (!beside && allLayersOf(state).length === 0) return null;
  // A close-up has its halves already.
  const isCloser = layout === "closer";
  const toggle = (kind: LayerCommand["kind"] & ("swipe" | "edges" | "beside"), isOn: boolean) => (
    <Button aria-pressed={isOn} onClick={() => perform(store, { kind })}>
      {t(`layer.${kind}`)}
    </Button>
  );
  return (
    <div class="group-part">
      <Row>
        <Button aria-pressed={store.layers.isBlinking.value} onClick={() => store.layers.blink()}>
          {t("layer.blink")}
        </Button>
        {!isCloser && toggle("swipe", swipe !== null)}
        {toggle("edges", has_edges)}
        {!isCloser && toggle("beside", beside !== null)}
        {!isCloser && beside && <Button onClick={() => perform(store, { kind: "swap" })}>{t("layer.swap")}</Button>}
      </Row>
      {swipe && (
        <Slider
          id="swipe-place"
          label={t("layer.divider")}
          range={[0, 1, 0.01]}
          value={swipe.share}
          words={`${number(100 * swipe.share)} %`}
          onSlide={(share) => store.change({ swipe: { share } })}
        />
      )}
    </div>
  );
}
