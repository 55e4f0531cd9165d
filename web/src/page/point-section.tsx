// The section of the panel with what is known of the marked point.

import { useComputed } from "@preact/signals";

import { type Key, t } from "../base/i18n.ts";
import { turnedTo } from "../model/commands.ts";
import { keyOf } from "../model/keys.ts";
import { hasSlices } from "../model/state.ts";
import { perform } from "../store/commands.ts";
import type { PointWords } from "../store/point.ts";
import { Chart } from "./chart.tsx";
import { Button, type OfStore, Quiet, Row, Section } from "./fields.tsx";

const LABELS: readonly (readonly [keyof PointWords, Key])[] = [
  ["position", "point.position"],
  ["voxel", "point.voxel"],
  ["depth", "point.depth-label"],
  ["intensity", "point.intensity"],
];

export function PointSection({ store }: OfStore) {
  const { point, view, places } = store;
  const words = point.words.value;
  const known = words ? (point.isDeep.value ? t("point.deep") : "") : t("point.hint");
  const isAcross = useComputed(() => view.state.value.across_deg !== null && hasSlices(view.state.value));
  // Beside an open place of a list the chart stands there.
  const isAtPlace = places.lists.some(({ open }) => open.value !== null);
  return (
    <Section title={t("panel.point")} isOpen data-task="read">
      <Quiet>{point.missed.value || known}</Quiet>
      {words && (
        <>
          <dl class="point">
            {LABELS.map(([name, label]) => (
              <>
                <dt>{t(label)}</dt>
                <dd class={name}>{words[name]}</dd>
              </>
            ))}
          </dl>
          <Tools store={store} isAcross={isAcross.value} />
          {!isAtPlace && <Chart store={store} />}
        </>
      )}
      <Row>
        <Button onClick={() => perform(store, { kind: "mark" })}>{t("point.mark")}</Button>
      </Row>
    </Section>
  );
}

function Tools({ store, isAcross }: OfStore & { readonly isAcross: boolean }) {
  const { view, shown } = store;
  const turn = (): void => {
    const { crosshair_mm } = view.now;
    if (crosshair_mm) store.change(turnedTo(crosshair_mm, shown), true);
  };
  const goToDepth = (): void => {
    const { crosshair_mm } = view.now;
    const depth_mm = (crosshair_mm && store.surface?.probe(crosshair_mm)?.depth_mm) ?? -1;
    if (depth_mm >= 0) view.goToDepth(depth_mm);
  };
  return (
    <Row>
      <Button
        aria-keyshortcuts={keyOf(({ kind }) => kind === "closer")}
        onClick={() => perform(store, { kind: "closer" })}
      >
        {t("closer.look")}
      </Button>
      <Button
        aria-keyshortcuts={keyOf(({ kind }) => kind === "across")}
        aria-pressed={isAcross}
        onClick={() => perform(store, { kind: "across" })}
      >
        {t("across.show")}
      </Button>
      <Button onClick={turn}>{t("point.turn")}</Button>
      <Button onClick={goToDepth}>{t("point.depth")}</Button>
      <Button onClick={() => store.forgetCross()}>{t("point.forget")}</Button>
    </Row>
  );
}
