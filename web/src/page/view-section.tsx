// The section of the panel with the direction, the part of the brain, the zoom, and the way back.

import { type ViewName, viewName } from "../model/camera.ts";
import { number, t } from "../base/i18n.ts";
import { ARROW_PIXELS } from "../model/keys.ts";
import { ZOOM_RANGE } from "../model/state.ts";
import { SURFACES } from "../model/surfaces.ts";
import { perform } from "../store/commands.ts";
import { Button, Buttons, IconButton, type OfStore, Row, Section, Slider } from "./fields.tsx";

/** As the letters stand in the row. */
const VIEW_ORDER: readonly ViewName[] = ["left", "right", "anterior", "posterior", "superior", "inferior"];

export function ViewSection({ store }: OfStore) {
  const { view } = store;
  const { orientation, surface, zoom } = view.state.value;
  const refusal = store.refusal.value;
  return (
    <Section title="panel.view" data-task="read">
      <Buttons
        name="letters"
        label={t("panel.view")}
        values={VIEW_ORDER}
        value={viewName(orientation)}
        words={(name) => t(`letter.${name}`)}
        about={(name) => ({ "aria-label": t(`view.${name}`), title: t(`view.${name}`) })}
        onChoose={(name) => perform(store, { kind: "view", name })}
      />
      <Buttons
        name="surfaces"
        label={t("panel.surface")}
        values={SURFACES}
        value={surface}
        words={(name) => t(`surface.${name}`)}
        // Left and right are the names of views, too.
        about={(name) => ({
          "aria-label": t(`surface.${name}-said`),
          ...(refusal && name !== "whole" && { disabled: true, title: refusal }),
        })}
        onChoose={(name) => perform(store, { kind: "surface", name })}
      />
      <Slider
        id="zoom"
        label={t("zoom.label")}
        range={[...ZOOM_RANGE.map(Math.log2), 0.05]}
        value={Number(Math.log2(zoom).toFixed(2))}
        words={`${number(zoom * 100)} %`}
        onSlide={(value) => store.change({ zoom: 2 ** value })}
      />
      <div class="pads">
        <Pad store={store} kind="turn" />
        <Pad store={store} kind="pan" />
      </div>
      <Row>
        <Button onClick={() => perform(store, { kind: "reset" })}>{t("reset")}</Button>
        <IconButton
          icon="undo"
          label={t("undo")}
          disabled={!view.canUndo.value}
          onClick={() => perform(store, { kind: "undo" })}
        />
        <IconButton
          icon="redo"
          label={t("redo")}
          disabled={!view.canRedo.value}
          onClick={() => perform(store, { kind: "redo" })}
        />
      </Row>
    </Section>
  );
}

const ARROWS = [
  ["left", -1, 0],
  ["up", 0, -1],
  ["down", 0, 1],
  ["right", 1, 0],
] as const;

/** Arrows that turn or move, for those who cannot drag. */
const Pad = ({ store, kind }: OfStore & { readonly kind: "turn" | "pan" }) => (
  <div class="line" role="group" aria-label={t(`${kind}.label`)}>
    <span class="line-label" aria-hidden="true">
      {t(`${kind}.label`)}
    </span>
    {ARROWS.map(([name, x, y]) => (
      <IconButton
        key={name}
        icon={name}
        label={t(`${kind}.${name}`)}
        onClick={() => perform(store, { kind, move: [x * ARROW_PIXELS, y * ARROW_PIXELS] })}
      />
    ))}
  </div>
);
