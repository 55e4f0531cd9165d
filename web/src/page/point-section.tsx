// The section of the panel with what is known of the marked point.

import { type Key, t } from "../base/i18n.ts";
import type { PointWords } from "../store/point.ts";
import { Chart } from "./chart.tsx";
import { IconButton, type OfStore, Quiet, Section } from "./fields.tsx";

const LABELS: readonly (readonly [keyof PointWords, Key])[] = [
  ["position", "point.position"],
  ["depth", "point.depth-label"],
  ["intensity", "point.intensity"],
];

export function PointSection({ store }: OfStore) {
  const { point, rows } = store;
  const words = point.words.value;
  const known = words ? (point.isDeep.value ? t("point.deep") : "") : t("point.hint");
  // The chart of an open place stands in its row.
  const { list, place } = rows.open.value ?? {};
  const isInRow = place && list?.open.value === place;
  return (
    <Section title="panel.point" data-task="read">
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
          <IconButton icon="trash" label={t("point.forget")} onClick={() => store.forgetCross()} />
          {!isInRow && <Chart store={store} />}
        </>
      )}
    </Section>
  );
}
