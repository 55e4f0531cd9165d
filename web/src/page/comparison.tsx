// The picture with its layers compared with the picture without them: by blinking, by a dividing line, by edges, side by
// side.

import { number, t } from "../base/i18n.ts";
import type { LayerCommand } from "../model/controls.ts";
import { perform } from "../store/commands.ts";
import { Button, type OfStore, Row, Slider } from "./fields.tsx";

export function Comparison({ store }: OfStore) {
  const { layer, overlay, beside, swipe, has_edges, layout } = store.view.state.value;
  if (!layer && !overlay && !beside) return null;
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
