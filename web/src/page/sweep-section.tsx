// What a sweep goes through, how fast, and whether it comes back.

import { number, t } from "../base/i18n.ts";
import { SWEEP_SPEEDS, type SweepChoice } from "../model/sweep.ts";
import { ChoiceLine, Line, type OfStore, Section, Ticked } from "./fields.tsx";

export function SweepSection({ store: { sweep } }: OfStore) {
  const choice = sweep.choice.value;
  const set = (change: Partial<SweepChoice>): void => sweep.choose({ ...choice, ...change });
  const end = (id: string, label: string, which: "from_mm" | "to_mm") => (
    <input
      type="number"
      id={id}
      min={0}
      step={0.5}
      aria-label={label}
      value={choice[which]}
      onChange={({ currentTarget }) => {
        set({ [which]: currentTarget.valueAsNumber });
        // What was typed may be out of range.
        currentTarget.value = String(sweep.choice.peek()[which]);
      }}
    />
  );
  return (
    <Section title={t("panel.sweep")} data-task="case">
      <Line label={t("sweep.range")}>
        {end("sweep-from", t("sweep.from"), "from_mm")}
        <span class="quiet">–</span>
        {end("sweep-to", t("sweep.to"), "to_mm")}
        <span class="quiet">mm</span>
      </Line>
      <ChoiceLine
        id="sweep-speed"
        label={t("sweep.speed")}
        values={SWEEP_SPEEDS}
        value={choice.mm_per_s}
        words={(speed) => `${number(speed)} mm/s`}
        onChoose={(mm_per_s) => set({ mm_per_s })}
      />
      <Ticked words={t("sweep.turns")} checked={choice.turns} onTick={(turns) => set({ turns })} />
    </Section>
  );
}
