// The section of the panel about how the picture is drawn.

import { useState } from "preact/hooks";

import { number, t } from "../base/i18n.ts";
import { readDepths } from "../model/query.ts";
import { CONVENTIONS, SLAB_LIMIT_MM, WAYS, boundOutlines, clampDepth } from "../model/state.ts";
import { choose, preferences } from "../store/preferences.ts";
import { ChoiceLine, Line, type OfStore, Section, Slider, Ticked, Typed } from "./fields.tsx";

export function DrawingSection({ store }: OfStore) {
  const { way, ambient, slab_mm, averages_shallow, convention } = store.view.state.value;
  return (
    <Section title={t("panel.drawing")} data-task="layers">
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
      <ChoiceLine
        isTall
        id="convention"
        label={t("convention.label")}
        values={CONVENTIONS}
        value={convention}
        words={(name) => t(`convention.${name}`)}
        onChoose={(name) => store.change({ convention: name }, true)}
      />
      {/* Whether the slices have one zoom. */}
      <Ticked
        id="linked-zoom"
        words={t("zoom.linked")}
        checked={preferences.value.linked_zoom}
        onTick={(linked_zoom) => choose({ linked_zoom })}
      />
      <Outlines store={store} />
    </Section>
  );
}

/** The depths whose outlines slices show. */
function Outlines({ store }: OfStore) {
  const [isUnread, setUnread] = useState(false);
  const { outlines_mm } = store.view.state.value;
  const written = outlines_mm.join(", ");
  return (
    <Line label={t("outlines.label")}>
      <Typed
        id="outlines"
        inputMode="decimal"
        placeholder="0, 20"
        aria-label={t("outlines.label")}
        aria-invalid={isUnread}
        value={written}
        onLeave={(typed) => {
          const depths = typed.trim() ? readDepths(typed, clampDepth(Infinity, store.shown)) : [];
          // What cannot be read stays to be corrected, and changes nothing.
          setUnread(!depths);
          if (!depths) return typed;
          const bound = boundOutlines(depths, store.shown);
          store.change({ outlines_mm: bound }, true);
          return bound.join(", ");
        }}
      />
      <span class="quiet">mm</span>
    </Line>
  );
}
