// A sweep through the depths: its range, its speed, and whether it goes there and back. Pure.

import { clamp } from "./space.ts";
import type { ReadyCase } from "./case.ts";
import { DEPTH_STEP_MM, clampDepth, stepDepth } from "./state.ts";

export interface SweepChoice {
  readonly from_mm: number;
  readonly to_mm: number;
  readonly mm_per_s: number;
  /** Whether it turns round at its ends; else it begins again. */
  readonly turns: boolean;
}

export const SWEEP_SPEEDS = [1, 2, 5, 10, 20] as const;

/** The whole depth of a case, there and back. */
export const wholeSweep = (shown: ReadyCase): SweepChoice => ({
  from_mm: 0,
  to_mm: Math.floor(clampDepth(Infinity, shown) / DEPTH_STEP_MM) * DEPTH_STEP_MM,
  mm_per_s: 5,
  turns: true,
});

/** The choice within what the case has: from the shallower to the deeper end, a step apart at least. */
export function boundSweep(choice: SweepChoice, shown: ReadyCase): SweepChoice {
  const deepest = wholeSweep(shown).to_mm;
  const ends = [choice.from_mm, choice.to_mm].map((end) => clamp(Number.isFinite(end) ? end : 0, 0, deepest));
  const [from, to] = [Math.min(...ends), Math.max(...ends)];
  const to_mm = clamp(to, from + DEPTH_STEP_MM, deepest);
  return { ...choice, from_mm: Math.max(Math.min(from, to_mm - DEPTH_STEP_MM), 0), to_mm };
}

/** How long a step of a sweep lasts. */
export const stepMs = ({ mm_per_s }: SweepChoice): number => (1000 * DEPTH_STEP_MM) / mm_per_s;

/** The depth, or the place of a slice, after a step, and the direction of the next: 1 is deeper. */
export function sweptDepth(
  depth_mm: number,
  direction: number,
  { from_mm, to_mm, turns }: Pick<SweepChoice, "from_mm" | "to_mm" | "turns">,
  step_mm = DEPTH_STEP_MM,
): readonly [number, number] {
  const within = clamp(depth_mm, from_mm, to_mm);
  // From beside the range, the nearer end comes first.
  if (within !== depth_mm) return [within, direction];
  const next = stepDepth(depth_mm, direction, step_mm);
  if (next >= from_mm && next <= to_mm) return [next, direction];
  if (!turns) return [direction > 0 ? from_mm : to_mm, direction];
  return [clamp(stepDepth(depth_mm, -direction, step_mm), from_mm, to_mm), -direction];
}
