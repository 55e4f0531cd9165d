// What the list of cases shows: its filters and its order, as the address keeps them and as the server is asked for them. Pure.

export const ORDERS = ["newest", "oldest", "label", "places", "findings"] as const;
export type Order = (typeof ORDERS)[number];

/** What is to be done with a case, and the trash. */
export const STATUSES = ["new", "begun", "signed", "preparing", "failed", "trash"] as const;
export type Status = (typeof STATUSES)[number];

/** Of how many days, with today. */
export const DAYS = ["1", "7", "30"] as const;

/** The ratings of a mask. */
export const MASKS = ["ok", "review", "failed"] as const;

/** What a case has at least one of: places that stand out, findings or layers. */
export const HAVINGS = ["places", "findings", "layers"] as const;

export interface Filter {
  readonly sort: Order;
  /** Empty: all but the trash. */
  readonly status: Status | "";
  /** Empty: of any day. */
  readonly days: (typeof DAYS)[number] | "";
  /** Empty: whatever its rating. */
  readonly mask: (typeof MASKS)[number] | "";
  /** Empty: whatever they have. */
  readonly has: (typeof HAVINGS)[number] | "";
  /** What is searched for, which no address has. */
  readonly text: string;
}

export const ALL: Filter = { sort: "newest", status: "", days: "", mask: "", has: "", text: "" };

/** What the fragment of the list begins with. */
export const LIST = "cases";

/** The fragment of the list, without what is searched for. */
export function listAddress(filter: Filter): string {
  const said = (["status", "days", "mask", "has", "sort"] as const).filter((key) => filter[key] !== ALL[key]);
  return `#${[LIST, ...said.map((key) => `${key}=${filter[key]}`)].join("&")}`;
}

/** The filter of a fragment's parts; what is not understood is as at first. */
export function readFilter(parts: readonly string[]): Filter {
  const of = <Word extends string>(key: string, words: readonly Word[]): Word | undefined =>
    words.find((word) => parts.includes(`${key}=${word}`));
  return {
    ...ALL,
    sort: of("sort", ORDERS) ?? ALL.sort,
    status: of("status", STATUSES) ?? ALL.status,
    days: of("days", DAYS) ?? ALL.days,
    mask: of("mask", MASKS) ?? ALL.mask,
    has: of("has", HAVINGS) ?? ALL.has,
  };
}

const DAY_MS = 86_400_000;
/** The longest text that the server looks for. */
const LONGEST_TEXT = 100;

/** What the server is asked for; `now_ms` since 1970. Without patients, a list that is asked for again and again fills no record. */
export function searchBody(
  { sort, status, days, mask, has, text }: Filter,
  now_ms: number,
): Readonly<Record<string, unknown>> {
  const from = new Date(now_ms - (Number(days) - 1) * DAY_MS).toISOString().slice(0, 10);
  const words = text.trim().slice(0, LONGEST_TEXT);
  return {
    patients: false,
    sort,
    ...(status === "trash" ? { trashed: true } : status && { status }),
    ...(days && { from }),
    ...(mask && { mask }),
    ...(has && { has }),
    ...(words && { text: words }),
  };
}
