// A case to test with.

import type { ReadyCase } from "../src/model/case.ts";

export const SHOWN: ReadyCase = {
  id: "0123456789abcdef0123456789abcdef",
  name: "A case",
  created_at: "2026-01-01T00:00:00Z",
  kept: false,
  state: "ready",
  closing_radius_mm: 10,
  mask_kind: "brain",
  offset_mm: 0,
  grid: {
    size: [100, 120, 90],
    spacing_mm: 1,
    patient_from_voxel: [
      [1, 0, 0, -50],
      [0, 1, 0, -40],
      [0, 0, 1, -30],
      [0, 0, 0, 1],
    ],
  },
  // Right to left, back to front, in thick slices.
  volume: {
    size: [110, 130, 50],
    spacing_mm: [1, 1, 2],
    patient_from_voxel: [
      [-1, 0, 0, 55],
      [0, -1, 0, 85],
      [0, 0, 2, -35],
      [0, 0, 0, 1],
    ],
  },
  max_depth_mm: 41.237,
  envelope_ml: 1400,
  envelope_sphere: { center_in_patient: [0, 20, 15], radius_mm: 80 },
  midsagittal: { normal: [1, 0, 0], offset_mm: 0 },
  intensity: { min: 0, max: 1000, window: { center: 400, width: 600 } },
};
