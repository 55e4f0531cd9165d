// The section of the panel about how the picture is drawn.

import { number, t } from "../base/i18n.ts";
import { SLAB_LIMIT_MM, WAYS } from "../model/state.ts";
import { ChoiceLine, type OfStore, Section, Slider, Ticked } from "./fields.tsx";

export function DrawingSection({ store }: OfStore) {
  const { way, ambient, slab_mm, averages_shallow } = store.view.state.value;
  return (
    <Section title="panel.drawing" data-task="layers">
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
        range={[0, Math.min(SLAB_LIMIT_MM, 5), 0.5]}
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
