// What a reader marks and writes of a case: plain values, and how two readers' lists become one.

import { type Depths, below } from "./isosurface.ts";
import type { MapName, Standard } from "./maps.ts";
import { isWay } from "./measure.ts";
import type { Side } from "./midsagittal.ts";
import type { Marked } from "./marks.ts";
import { type Vec3, distance, meanOf } from "./space.ts";
import { parsed, plainLine, plainText } from "./text.ts";

export const CERTAINTIES = ["definite", "probable", "possible", "unlikely"] as const;
export type Certainty = (typeof CERTAINTIES)[number];
export const FINDING_KINDS = ["point", "line", "polygon", "trajectory", "acpc"] as const;
export type FindingKind = (typeof FINDING_KINDS)[number];

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
  /** It was taken over from another case, and nobody has confirmed its place in this one. */
  readonly is_unconfirmed?: true;
  readonly author?: string;
  /** Set by the server. */
  readonly side?: Side;
  readonly gyrus?: string;
  readonly standard?: Standard;
  readonly created_at?: string;
  readonly changed_at?: string;
}

/** The colour of a finding that nobody has coloured. */
export const FIRST_COLOUR = "#ffb000";

export type NewFinding = Pick<Finding, "points_in_patient" | "depth_mm"> & Partial<Finding>;

/** A finding that nobody has written about; the anterior one of two commissures is the first. */
export const newFinding = (given: NewFinding): Finding => ({
  id: crypto.randomUUID(),
  kind: "point",
  label: "",
  note: "",
  colour: FIRST_COLOUR,
  is_dismissed: false,
  ...given,
  ...(given.kind === "acpc" && { points_in_patient: given.points_in_patient.toSorted(([, y], [, z]) => y - z) }),
  depth_mm: Math.max(0, Number(given.depth_mm.toFixed(2))) || 0,
});

/** The longest label and note that the server accepts. */
export const LONGEST_LABEL = 200;
export const LONGEST_NOTE = 10_000;

/** What a reader wrote, as the server accepts it. */
export function plainFinding(finding: Finding): Finding {
  const { author } = finding;
  return {
    ...finding,
    label: plainLine(finding.label, LONGEST_LABEL),
    note: plainText(finding.note, LONGEST_NOTE),
    ...(author !== undefined && { author: plainLine(author, LONGEST_LABEL) }),
  };
}

/** A finding with an author: who made it, or who was the first to change it once it was known who reads. */
export const signed = (finding: Finding, reader: string): Finding =>
  finding.author || reader === "" ? finding : { ...finding, author: reader };

export const middleOf = ({ points_in_patient }: Pick<Finding, "points_in_patient">): Vec3 => meanOf(points_in_patient);

/** What a reader wrote, without what the server adds. */
const written = ({
  side: _side,
  gyrus: _gyrus,
  standard: _standard,
  created_at: _created,
  changed_at: _changed,
  ...rest
}: Finding): string => JSON.stringify(Object.entries(rest).sort(([one], [other]) => (one < other ? -1 : 1)));

/** Whether a reader wrote the same in both. */
export const isSame = (one: Finding | undefined, other: Finding | undefined): boolean =>
  one === other || (one !== undefined && other !== undefined && written(one) === written(other));

/** Whether both lists say the same, in the same order. */
export const areSame = (one: readonly Finding[], other: readonly Finding[]): boolean =>
  one.length === other.length && one.every((finding, at) => isSame(finding, other[at]));

/** Whether it states where the commissures are, which a list does once. */
const isAcpc = ({ kind, is_dismissed, is_unconfirmed }: Finding): boolean =>
  kind === "acpc" && !is_dismissed && !is_unconfirmed;

/** A list with the commissures once; if they are there twice, those that come first, or those that are preferred. */
export function withOneAcpc(list: readonly Finding[], isPreferred: (finding: Finding) => boolean): readonly Finding[] {
  const all = list.filter(isAcpc);
  const kept = all.find(isPreferred) ?? all[0];
  return list.filter((one) => one === kept || !isAcpc(one));
}

/** Two lists as one. */
export interface Merged {
  readonly list: readonly Finding[];
  /** The findings that both readers had changed, each of which is there twice: the id of both, and the new one of this reader's. */
  readonly moved: readonly (readonly [string, string])[];
}

/**
 * Joins what this reader changed with what another one changed, both from `base`. What only one of them has changed is as
 * that one left it; what both have changed otherwise is kept as both left it, so that nothing is lost. Of commissures, this reader's are kept.
 */
export function merged(base: readonly Finding[], mine: readonly Finding[], theirs: readonly Finding[]): Merged {
  const by = (list: readonly Finding[]) => new Map(list.map((finding) => [finding.id, finding]));
  const [before, own, other] = [by(base), by(mine), by(theirs)];
  const list: Finding[] = [];
  const moved: [string, string][] = [];
  for (const id of inOrder([...other.keys()], [...own.keys()])) {
    const [was, here, there] = [before.get(id), own.get(id), other.get(id)];
    if (isSame(here, was) || isSame(here, there)) {
      if (there) list.push(there);
    } else if (isSame(there, was) || !there || (here && isAcpc(here) && isAcpc(there))) {
      if (here) list.push(here);
    } else {
      list.push(there);
      if (!here) continue;
      const own = { ...here, id: crypto.randomUUID() };
      list.push(own);
      moved.push([id, own.id]);
    }
  }
  return { list: withOneAcpc(list, ({ id }) => own.has(id)), moved };
}

/** The ids of both lists: those of the other one as they stand there, and mine before those that they stand before here, so that no number changes. */
function inOrder(other: readonly string[], own: readonly string[]): readonly string[] {
  const places = new Map(other.map((id, at) => [id, at]));
  const before = new Map<number, string[]>();
  let at = other.length;
  for (const id of own.toReversed()) {
    const place = places.get(id);
    if (place !== undefined) at = place;
    else before.set(at, [id, ...(before.get(at) ?? [])]);
  }
  return [...other, null].flatMap((id, here) => [...(before.get(here) ?? []), ...(id === null ? [] : [id])]);
}

/** So near are the points of a finding that has been in a file of DICOM, in mm: there they have 24 bits. */
const SAME_MM = 0.001;

/** Whether both are the same finding, but for what a file rounds. */
const isRounded = (one: Finding, other: Finding): boolean =>
  isSame({ ...one, points_in_patient: other.points_in_patient, depth_mm: other.depth_mm }, other) &&
  Math.abs(one.depth_mm - other.depth_mm) < SAME_MM &&
  one.points_in_patient.length === other.points_in_patient.length &&
  one.points_in_patient.every((point, at) => distance(point, other.points_in_patient[at] ?? point) < SAME_MM);

/**
 * A list with those of a file behind it. What is there already is not added. What is there but says something else is kept as
 * both say it, that of the file behind the one that was there; but commissures of a file replace those that are there.
 */
export function joined(
  own: readonly Finding[],
  given: readonly Finding[],
): { readonly list: readonly Finding[]; readonly doubled: number } {
  const ids = new Set(own.map(({ id }) => id));
  const added = given.filter(({ id }) => !ids.has(id));
  const others = new Map(given.map((finding) => [finding.id, finding]));
  let doubled = 0;
  const list = own.flatMap((known) => {
    const other = others.get(known.id);
    if (!other || isRounded(other, known)) return known;
    if (!isAcpc(known) || !isAcpc(other)) doubled += 1;
    return [known, { ...other, id: crypto.randomUUID() }];
  });
  return { list: withOneAcpc([...list, ...added], (one) => !own.includes(one)), doubled };
}

/** The text of a file as findings; null if it is no list of them. The server checks the values. */
export function readFindings(text: string): readonly Finding[] | null {
  const list = (parsed(text) as { readonly findings?: unknown } | null)?.findings;
  if (!Array.isArray(list)) return null;
  const findings = list.map(readFinding);
  return findings.every((one) => one !== null) ? findings : null;
}

function readFinding(given: unknown): Finding | null {
  if (typeof given !== "object" || given === null) return null;
  const one: Partial<Record<keyof Finding, unknown>> = given;
  const kind = FINDING_KINDS.find((known) => known === one.kind);
  const points = Array.isArray(one.points_in_patient) ? one.points_in_patient : [];
  const arePoints = points.length > 0 && points.every(isPoint);
  if (typeof one.id !== "string" || !kind || !arePoints || typeof one.depth_mm !== "number") return null;
  const { side: _side, gyrus: _gyrus, standard: _standard, created_at: _created, changed_at: _changed, ...rest } = one;
  const { label = "", note = "", colour = FIRST_COLOUR, is_dismissed = false } = rest;
  if (![label, note, colour].every((text) => typeof text === "string")) return null;
  return { ...rest, label, note, colour, is_dismissed } as Finding;
}

const isPoint = (given: unknown): given is Vec3 =>
  Array.isArray(given) && given.length === 3 && given.every((part) => typeof part === "number");

/** Those that are not dismissed and not the commissures: they have numbers, from 1. */
export const numbered = (findings: readonly Finding[]): readonly Finding[] =>
  findings.filter(({ is_dismissed, kind }) => !is_dismissed && kind !== "acpc");

/** Whether it is the line of the commissures, which is drawn. */
const isAxis = ({ is_dismissed, kind }: Finding): boolean => !is_dismissed && kind === "acpc";

/** Where a point is at another depth. */
export type Slide = (position_in_patient: Vec3, depth_mm: number) => Vec3;

/** So near to its own depth a finding is where it was marked, in mm. */
const OWN_MM = 0.005;

/** Points so far from the surface of their finding's depth are not on it, in mm. */
const OFF_MM = 1.5;

/** Whether a point of a finding does not lie on the surface of the finding's depth, such as those of a line in a slice. */
export const isOff = (depths: Depths, { points_in_patient, depth_mm }: Finding): boolean =>
  points_in_patient.some((point) => {
    // Of a point of a slice the depth is known, not where the smoothed surface of that depth is.
    const off_mm = Math.min(Math.abs(below(depths, point, depth_mm)), Math.abs(depths.depthAt(point) - depth_mm));
    return off_mm > Math.max(OFF_MM, depths.voxel_mm);
  });

/**
 * The findings as they are drawn, but for those that are dismissed or hidden; `off` are those that lie beside the
 * surface of their depth: they are where they were marked, whatever depth is shown.
 */
export const markedFindings = (
  findings: readonly Finding[],
  hidden: ReadonlySet<string>,
  slide: Slide,
  off: (finding: Finding) => boolean = () => false,
  axis = "AC–PC",
): readonly Marked[] =>
  [...numbered(findings), ...findings.filter(isAxis)].flatMap((finding, at) => {
    const { id, kind, points_in_patient, depth_mm, colour, is_unconfirmed } = finding;
    if (hidden.has(id)) return [];
    const isStraight = isWay(kind);
    const isBeside = !isStraight && off(finding);
    // The head turns more often than the depth changes.
    let slid: { readonly mm: number; readonly points: readonly Vec3[] } | null = null;
    const slidTo = (mm: number): readonly Vec3[] => {
      if (slid?.mm !== mm) slid = { mm, points: points_in_patient.map((point) => slide(point, mm)) };
      return slid.points;
    };
    return {
      words: `${isAxis(finding) ? axis : at + 1}${is_unconfirmed ? "?" : ""}`,
      points_in_patient,
      isClosed: kind === "polygon",
      colour,
      depth_mm: isStraight ? null : depth_mm,
      // A line that was set in a slice is on no surface.
      isOnSurface: !isBeside || kind === "point",
      isOff: isBeside,
      pointsAt: (shown_mm) =>
        isStraight || isBeside || Math.abs(shown_mm - depth_mm) < OWN_MM ? points_in_patient : slidTo(shown_mm),
    };
  });

/** What a reader decides about a place. */
export const JUDGEMENTS = ["kept", "dismissed"] as const;
export type Judgement = (typeof JUDGEMENTS)[number];

/** So near to a place a finding is of it, in mm. */
const SAME_PLACE_MM = 0.5;

const isAt = (one: Vec3, other: Vec3): boolean => distance(one, other) < SAME_PLACE_MM;

/** The newest finding in the middle of which a mark is. */
export const findingAt = (findings: readonly Finding[], mark: Vec3): Finding | undefined =>
  findings.findLast((one) => isAt(middleOf(one), mark));

/** The finding that was taken from a place of the list. */
export const findingOfPlace = (findings: readonly Finding[], position_in_patient: Vec3): Finding | undefined =>
  findings.find(
    ({ kind, from_map, points_in_patient: [point] }) =>
      kind === "point" && from_map && point && isAt(point, position_in_patient),
  );
