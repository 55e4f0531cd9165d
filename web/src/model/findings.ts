// What a reader marks and writes of a case: plain values, and how two readers' lists become one.

import type { MapName } from "./maps.ts";
import type { Side } from "./midsagittal.ts";
import type { Projection } from "./camera.ts";
import type { Mark } from "./marks.ts";
import type { Vec2, Vec3 } from "./space.ts";

export const CERTAINTIES = ["definite", "probable", "possible", "unlikely"] as const;
export type Certainty = (typeof CERTAINTIES)[number];
export const FINDING_KINDS = ["point", "line", "polygon", "trajectory"] as const;
export type FindingKind = (typeof FINDING_KINDS)[number];

/** A finding, as the server stores it. */
export interface Finding {
  readonly id: string;
  readonly kind: FindingKind;
  readonly points_in_patient: readonly Vec3[];
  readonly depth_mm: number;
  readonly label: string;
  readonly note: string;
  readonly certainty?: Certainty;
  readonly colour: string;
  readonly from_map?: MapName;
  readonly is_dismissed: boolean;
  readonly author?: string;
  /** Set by the server. */
  readonly side?: Side;
  readonly created_at?: string;
  readonly changed_at?: string;
}

/** The colour of a finding that nobody has coloured. */
export const FIRST_COLOUR = "#ffb000";

/** A place that is marked as a finding. */
export const findingAt = (position: Vec3, depth_mm: number, from_map: MapName | null): Finding => ({
  id: crypto.randomUUID(),
  kind: "point",
  points_in_patient: [position],
  depth_mm,
  label: "",
  note: "",
  colour: FIRST_COLOUR,
  is_dismissed: false,
  ...(from_map && { from_map }),
});

/** The middle of what was marked. */
export function middleOf({ points_in_patient }: Finding): Vec3 {
  const sum = (axis: 0 | 1 | 2): number => points_in_patient.reduce((all, point) => all + point[axis], 0);
  const count = points_in_patient.length;
  return [sum(0) / count, sum(1) / count, sum(2) / count];
}

/** What a reader wrote, without what the server adds. */
const written = ({ side: _side, created_at: _created, changed_at: _changed, ...rest }: Finding): string =>
  JSON.stringify(Object.entries(rest).sort(([one], [other]) => (one < other ? -1 : 1)));

/** Whether a reader wrote the same in both. */
export const isSame = (one: Finding | undefined, other: Finding | undefined): boolean =>
  one === other || (one !== undefined && other !== undefined && written(one) === written(other));

/** Whether both lists say the same, in the same order. */
export const areSame = (one: readonly Finding[], other: readonly Finding[]): boolean =>
  one.length === other.length && one.every((finding, at) => isSame(finding, other[at]));

/** Two lists as one. */
export interface Merged {
  readonly list: readonly Finding[];
  /** How many findings both readers had changed: each is there twice. */
  readonly doubled: number;
}

/**
 * Joins what this reader changed with what another one changed, both from `base`. What only one of them has changed is as
 * that one left it; what both have changed otherwise is kept as both left it, so that nothing is lost.
 */
export function merged(base: readonly Finding[], mine: readonly Finding[], theirs: readonly Finding[]): Merged {
  const by = (list: readonly Finding[]) => new Map(list.map((finding) => [finding.id, finding]));
  const [before, own, other] = [by(base), by(mine), by(theirs)];
  const list: Finding[] = [];
  let doubled = 0;
  for (const id of new Set([...other.keys(), ...own.keys()])) {
    const [was, here, there] = [before.get(id), own.get(id), other.get(id)];
    if (isSame(here, was) || isSame(here, there)) {
      if (there) list.push(there);
    } else if (isSame(there, was) || !there) {
      if (here) list.push(here);
    } else {
      list.push(there);
      if (!here) continue;
      list.push({ ...here, id: crypto.randomUUID() });
      doubled += 1;
    }
  }
  return { list, doubled };
}

/** A finding of another depth than the one that is shown by more than this is drawn dashed, in mm. */
const AWAY_MM = 1;
/** A slice shows what lies so near to it, in mm; dashed, what does not lie in it. */
const NEAR_MM = 4;

type Placed = (finding: Finding, number: number) => Mark | null;

/** Those that are not dismissed: they have numbers, from 1. */
export const numbered = (findings: readonly Finding[]): readonly Finding[] =>
  findings.filter(({ is_dismissed }) => !is_dismissed);

/** The marks of the findings that have a place in a picture. */
const marksOf = (findings: readonly Finding[], placed: Placed): readonly Mark[] =>
  numbered(findings).flatMap((finding, at) => placed(finding, at + 1) ?? []);

/** The findings on the half of the head that faces the viewer. */
export const surfaceMarks = (
  findings: readonly Finding[],
  depth_mm: number,
  { pixelOf }: Pick<Projection, "pixelOf">,
): readonly Mark[] =>
  marksOf(findings, (finding, number) => {
    if (pixelOf(middleOf(finding))[2] < 0) return null;
    return {
      number,
      places: finding.points_in_patient.map((point): Vec2 => {
        const [x, y] = pixelOf(point);
        return [x, y];
      }),
      isClosed: finding.kind === "polygon",
      colour: finding.colour,
      isAway: Math.abs(finding.depth_mm - depth_mm) > AWAY_MM,
    };
  });

/** The findings in a slice across an axis. */
export const sliceMarks = (
  findings: readonly Finding[],
  axis: 0 | 1 | 2,
  position_mm: number,
  pixelOf: (point: Vec3) => Vec2,
): readonly Mark[] =>
  marksOf(findings, (finding, number) => {
    const away = finding.points_in_patient.map((point) => Math.abs(point[axis] - position_mm));
    const nearest = Math.min(...away);
    if (nearest > NEAR_MM) return null;
    const near = finding.points_in_patient.filter((_, at) => (away[at] ?? Infinity) <= NEAR_MM);
    const isWhole = near.length === finding.points_in_patient.length;
    return {
      number,
      places: near.map(pixelOf),
      isClosed: finding.kind === "polygon" && isWhole,
      colour: finding.colour,
      isAway: nearest > AWAY_MM || !isWhole,
    };
  });
