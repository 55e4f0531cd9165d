// The section of the panel with the window and the colours of the picture.

import { plainNumber, readNumber, t } from "../base/i18n.ts";
import type { Window } from "../model/case.ts";
import { boundWindow } from "../model/controls.ts";
import { COLORMAPS, WINDOW_PRESETS, presetWindow, textureOf } from "../model/state.ts";
import { perform } from "../store/commands.ts";
import { Button, Buttons, ChoiceLine, Line, type OfStore, Section, Typed } from "./fields.tsx";

export function WindowSection({ store }: OfStore) {
  const { state } = store.view;
  const { window, colormap } = state.value;
  const texture = textureOf(state.value, store.shown);
  const isSame = (other: Window): boolean =>
    Math.abs(other.center - window.center) + Math.abs(other.width - window.width) < 1e-3 * window.width;
  const shown = WINDOW_PRESETS.find((preset) => isSame(boundWindow(presetWindow(preset, texture), texture)));
  return (
    <Section title="panel.window" data-task="read layers">
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
        onChoose={(name) => store.change({ colormap: name }, true)}
      >
        <Button onClick={() => perform(store, { kind: "invert" })}>{t("invert")}</Button>
      </ChoiceLine>
    </Section>
  );
}

/** The level or the width, as a slider, which reaches as far as the values of the texture, and as a number in four figures. */
function WindowPart({ store, part }: OfStore & { readonly part: keyof Window }) {
  const { state } = store.view;
  const { window } = state.value;
  const texture = textureOf(state.value, store.shown);
  const { min, max } = texture.intensity;
  const range = max - min || 1;
  const [low, high] = part === "center" ? [min + 0.5, max + 0.5] : [1 + range / 500, 1 + range];
  const label = t(`window.${part}`);
  const take = (value: number): void => {
    if (Number.isFinite(value) && (part === "center" || value >= 1))
      store.change({ window: boundWindow({ ...store.view.now.window, [part]: value }, texture) });
  };
  const written = (): string => plainNumber(store.view.now.window[part], 4);
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
