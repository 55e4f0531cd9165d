// The scale of the depth slider: its first half covers 0 to 25 mm, where the cortex is read; pure.

/** The depth at the slider's middle, where the case is deep enough. */
const MIDDLE_MM = 25;

/** Depths that a slider may be marked with. */
const TICKS_MM = [0, 6, 10, 15, 20, 25, 40, 60, 80] as const;

const middleOf = (deepest_mm: number): number => Math.min(MIDDLE_MM, deepest_mm / 2);

/** Where on the slider a depth is, 0 to 1. */
export function shareOfDepth(depth_mm: number, deepest_mm: number): number {
  const middle = middleOf(deepest_mm);
  if (!(deepest_mm > 0)) return 0;
  return depth_mm <= middle ? depth_mm / middle / 2 : 0.5 + (depth_mm - middle) / (deepest_mm - middle) / 2;
}

export function depthOfShare(share: number, deepest_mm: number): number {
  const middle = middleOf(deepest_mm);
  return share <= 0.5 ? 2 * share * middle : middle + (2 * share - 1) * (deepest_mm - middle);
}

export const ticksTo = (deepest_mm: number): readonly number[] => TICKS_MM.filter((tick) => tick <= deepest_mm);
