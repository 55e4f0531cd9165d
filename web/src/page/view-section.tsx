// The section of the panel with the direction, the part of the brain and the zoom.

import { VIEW_NAMES, viewName } from "../model/camera.ts";
import { number, t } from "../base/i18n.ts";
import { WAYS, ZOOM_RANGE } from "../model/state.ts";
import { SURFACES } from "../model/surfaces.ts";
import { perform } from "../store/commands.ts";
import { Button, Buttons, ChoiceLine, type OfStore, Row, Section, Slider, Ticked } from "./fields.tsx";

export function ViewSection({ store }: OfStore) {
  const { view } = store;
  const { orientation, surface, zoom } = view.state.value;
  const refusal = store.refusal.value;
  return (
    <Section title="panel.view" data-task="read">
      <Buttons
        name="letters"
        label={t("panel.view")}
        values={VIEW_NAMES}
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
      <Row>
        <Button onClick={() => perform(store, { kind: "reset" })}>{t("reset")}</Button>
      </Row>
    </Section>
  );
}

export function DrawingSection({ store }: OfStore) {
  const { way, ambient, slab_mm, averages_shallow } = store.view.state.value;
  return (
    <Section title="panel.drawing" data-task="images">
      <ChoiceLine
        id="way"
        label={t("way.label")}
        values={WAYS}
        value={way}
        words={(name) => t(`way.${name}`)}
        onChoose={(name) => store.change({ way: name }, true)}
      />
      <Slider
        id="light"
        label={t("light.label")}
        range={[0, 1, 0.05]}
        value={Number((1 - ambient).toFixed(2))}
        words={`${number(100 * (1 - ambient))} %`}
        onSlide={(share) => store.change({ ambient: Number((1 - share).toFixed(2)) })}
      />
      <Slider
        id="slab"
        label={t("slab.label")}
        range={[0, 5, 0.5]}
        value={slab_mm}
        words={`±${number(slab_mm, 1)} mm`}
        onSlide={(value) => store.change({ slab_mm: value })}
      />
      <Ticked
        id="averages"
        words={t("averages.label")}
        checked={averages_shallow}
        onTick={(isTicked) => store.change({ averages_shallow: isTicked }, true)}
      />
    </Section>
  );
}
