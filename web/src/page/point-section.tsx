// The section of the panel with what is known of the marked point.

import { useComputed } from "@preact/signals";

import { type Key, t } from "../base/i18n.ts";
import { keyOf } from "../model/keys.ts";
import { hasSlices } from "../model/state.ts";
import { bring } from "../store/bring.ts";
import { perform } from "../store/commands.ts";
import type { PointWords } from "../store/point.ts";
import { Chart } from "./chart.tsx";
import { Button, IconButton, type OfStore, Quiet, Row, Section } from "./fields.tsx";

const LABELS: readonly (readonly [keyof PointWords, Key])[] = [
  ["position", "point.position"],
  ["depth", "point.depth-label"],
  ["intensity", "point.intensity"],
];

export function PointSection({ store }: OfStore) {
  const { point, view, places } = store;
  const words = point.words.value;
  const known = words ? (point.isDeep.value ? t("point.deep") : "") : t("point.hint");
  const isAcross = useComputed(() => view.state.value.across_deg !== null && hasSlices(view.state.value));
  const turn = (): void => {
    const { crosshair_mm: mark } = view.now;
    if (mark) bring(store, mark, store.surface?.wholeDepth(mark) ?? null);
  };
  // Beside an open place of a list the chart stands there.
  const isAtPlace = places.lists.some(({ open }) => open.value !== null);
  return (
    <Section title="panel.point" data-task="read">
      <Quiet>{point.missed.value || known}</Quiet>
      {words ? (
        <>
          <dl class="point">
            {LABELS.map(([name, label]) => (
              <>
                <dt>{t(label)}</dt>
                <dd class={name}>{words[name]}</dd>
              </>
            ))}
          </dl>
          <Row>
            <Button
              aria-keyshortcuts={keyOf(({ kind }) => kind === "across")}
              aria-pressed={isAcross.value}
              onClick={() => perform(store, { kind: "across" })}
            >
              {t("across.show")}
            </Button>
            <Button onClick={turn}>{t("point.turn")}</Button>
            <IconButton icon="trash" label={t("point.forget")} onClick={() => store.forgetCross()} />
          </Row>
          {!isAtPlace && <Chart store={store} />}
        </>
      ) : (
        <Row>
          <Button onClick={() => perform(store, { kind: "mark" })}>{t("point.mark")}</Button>
        </Row>
      )}
    </Section>
  );
}
