// The server's interface. A token lives in this module's memory alone.

import { parsed } from "../model/text.ts";
import type { Case, Listed, ProblemBody } from "../model/case.ts";
import type { LayerList } from "../model/layers.ts";
import type { CandidateList, ListingMap } from "../model/maps.ts";
import type { PartName } from "../model/surfaces.ts";
import { taken } from "./kept.ts";
import { wait } from "./patience.ts";

let token = "";
let askForToken: Ask = async () => "";
let hearReach: (reachable: boolean) => void = () => {};
let reachable = true;

/** An answer that is not a success. */
export class Problem extends Error {
  constructor(
    /** 0 where there was no answer. */
    readonly status: number,
    /** The last part of the problem's type, `no-such-case` for one; empty where it has none. */
    readonly kind: string,
    /** The server's own sentence; empty where it gave none. */
    readonly detail: string,
    /** Seconds after which the server would like to be asked again; 0 where it did not say. */
    readonly retryAfter = 0,
    /** The name of the reason, if it is one of several; else empty. */
    readonly reason = "",
  ) {
    super(detail || kind || `status ${status}`);
  }
}

/** Why the server has not accepted a request. */
export interface Refusal {
  readonly problem: Problem;
  /** Whether it came with a token. */
  readonly hadToken: boolean;
}

/** Resolves to the token that the user typed, empty if none, and to null if a proxy may know the user by now. */
type Ask = (refusal: Refusal) => Promise<string | null>;

/** `ask` is called whenever the server answers 401. */
export function onTokenWanted(ask: Ask): void {
  // Many requests may be refused at once; the user is asked once.
  let asking: ReturnType<Ask> | null = null;
  askForToken = (refusal) => (asking ??= ask(refusal).finally(() => (asking = null)));
}

/** `hear` is called when the server stops answering, and when it answers again. */
export function onReach(hear: (reachable: boolean) => void): void {
  hearReach = hear;
}

function reached(now: boolean): void {
  if (now === reachable) return;
  reachable = now;
  hearReach(now);
  if (!now) void knock();
}

/** Asks a silent server again and again, until it answers. */
async function knock(): Promise<void> {
  while (!reachable) {
    await wait(1000);
    try {
      // A server that is starting or stopping is not there yet.
      reached((await fetch("readyz", { cache: "no-store" })).ok);
    } catch {
      // Still silent.
    }
  }
}

/** Sends a request in the place of `fetch`. */
export type Carrier = (path: string, options: RequestInit) => Promise<Response>;

const carriers: { readonly prefix: string; readonly carry: Carrier }[] = [];

/** Lets a carrier send the requests that begin with a prefix, where there is no server, as in a notebook or a file; the last one counts. */
export function carryBy(prefix: string, carry: Carrier): () => void {
  const one = { prefix, carry };
  carriers.push(one);
  return () => void carriers.splice(carriers.indexOf(one), 1);
}

const carrierOf = (path: string): Carrier =>
  carriers.findLast(({ prefix }) => path.startsWith(prefix))?.carry ?? ((to, options) => fetch(to, options));

const authorization = (): Record<string, string> => (token ? { authorization: `Bearer ${token}` } : {});

/** Leaves a token that was typed to the next page, which asks nobody a second time, and what this one shows. */
export function handOver(): void {
  sessionStorage.token = token;
  sessionStorage.left = location.hash;
}

/** Takes what was left, once: a token, and what was shown. */
export const takeHanded = (): { readonly token: string; readonly left: string } => ({
  token: taken("token"),
  left: taken("left"),
});

/** Waits for another token than the one `sent` where `problem` is a 401; true when it is worth trying again. */
async function tokenEntered(problem: unknown, sent: string): Promise<boolean> {
  if (!(problem instanceof Problem) || problem.status !== 401) return false;
  // Another request may have brought a token in the meantime.
  if (token === sent) {
    const entered = await askForToken({ problem, hadToken: sent !== "" });
    if (entered === null) return true;
    token = entered;
  }
  return token !== "";
}

/** Whose token it is, and what it permits. */
export interface Holder {
  readonly name: string;
  readonly scopes: readonly string[];
  /** Where the proxy signs out whom it has signed in. */
  readonly sign_out?: string;
}

/** Whether the page was loaded through a proxy that signs people in; false if the server does not say. */
export async function isBehindProxy(): Promise<boolean> {
  try {
    const answer = await fetch("sign-in", { cache: "no-store" });
    return ((await answer.json()) as { readonly by_proxy?: boolean }).by_proxy === true;
  } catch {
    return false;
  }
}

const BY_PROXY = "proxy:";

/** Whether a proxy has signed somebody in. */
export const isByProxy = ({ name }: Pick<Holder, "name">): boolean => name.startsWith(BY_PROXY);

/** The name of somebody as people know it. */
export const plainName = (holder: Pick<Holder, "name">): string =>
  isByProxy(holder) ? holder.name.slice(BY_PROXY.length) : holder.name;

export const getHolder = (): Promise<Holder> => ask("v1/session");

/** A successful answer; anything else is a `Problem`, or the signal's reason. */
export async function send(path: string, options: RequestInit = {}): Promise<Response> {
  for (;;) {
    const sent = token;
    let response: Response;
    try {
      response = await carrierOf(path)(path, { ...options, headers: { ...options.headers, ...authorization() } });
    } catch (error) {
      if (options.signal?.aborted) throw error;
      reached(false);
      throw new Problem(0, "unreachable", "");
    }
    reached(true);
    if (response.ok) return response;
    const problem = problemFrom(response.status, response.headers, await response.text().catch(() => ""));
    if (!(await tokenEntered(problem, sent))) throw problem;
  }
}

/** What an answer states; it is asked for anew unless the options say otherwise. */
export const ask = async <Answer>(path: string, options: RequestInit = { cache: "no-store" }): Promise<Answer> =>
  (await send(path, options)).json() as Promise<Answer>;

/** The last part of a problem's type; empty if it has none. */
export const kindOf = (problem: ProblemBody | undefined): string =>
  String(problem?.type ?? "")
    .split(":")
    .at(-1) ?? "";

/** What the server answers to a body of JSON. */
export const post = <Answer>(path: string, body: unknown): Promise<Answer> =>
  ask(path, { method: "POST", body: JSON.stringify(body) });

/** Reads a problem+json body; another body is not shown. */
export function problemFrom(status: number, headers: { get(name: string): string | null }, body: string): Problem {
  // A body that is no JSON says nothing to the user; the status does.
  const isJson = headers.get("content-type")?.includes("json");
  const problem = ((isJson && parsed(body)) || {}) as ProblemBody;
  return new Problem(
    status,
    kindOf(problem),
    String(problem.detail ?? problem.title ?? ""),
    Number(headers.get("retry-after")) || 0,
    String(problem.reason ?? ""),
  );
}

/** A page of cases, newest first; `next` is the cursor of the page after, if any. */
interface CasePage {
  readonly cases: readonly Case[];
  readonly next?: string;
}

/** So many of the cases that fulfil conditions, behind the first ones of them, and how many there are. */
export const searchCases = (
  conditions: Readonly<Record<string, unknown>>,
  skip: number,
  limit: number,
): Promise<{ readonly cases: readonly Listed[]; readonly total: number }> =>
  post("v1/cases/search", { ...conditions, skip, limit });

export async function allCases(): Promise<Case[]> {
  const cases: Case[] = [];
  for (let after: string | null = null; ;) {
    const page: CasePage = await ask(`v1/cases?${new URLSearchParams({ limit: "200", ...(after && { after }) })}`);
    cases.push(...page.cases);
    if (!page.next) return cases;
    after = page.next;
  }
}

export async function anyArrivals(): Promise<boolean> {
  return (await ask<{ readonly arrivals: readonly unknown[] }>("v1/arrivals?limit=1")).arrivals.length > 0;
}

/** A case; with a part, its facts are those of that surface. */
export const getCase = (id: string, part: PartName | null = null): Promise<Case> =>
  ask(`v1/cases/${id}${part ? `?surface=${part}` : ""}`);

/** Renames a case, keeps it whatever its age or no longer, or puts it into the trash or takes it out; the case as it is then. */
export const changeCase = (
  id: string,
  change: { readonly name?: string; readonly kept?: boolean; readonly trashed?: boolean },
): Promise<Case> => ask(`v1/cases/${id}`, { method: "PATCH", body: JSON.stringify(change) });

export async function deleteCase(id: string): Promise<void> {
  await send(`v1/cases/${id}`, { method: "DELETE" });
}

/** The places of a case that a map lists, the highest score first; `limit` of them at most. */
export const getCandidates = (id: string, limit: number, map: ListingMap): Promise<CandidateList> =>
  ask(`v1/cases/${id}/candidates?limit=${limit}&map=${map}`, { cache: "no-cache" });

/** The layers of a case: its maps, then those that were added, in their order. */
export const listLayers = (id: string): Promise<LayerList> => ask(`v1/cases/${id}/layers`);

/** Renames an added layer, or moves it to another place among them. */
export async function changeLayer(
  id: string,
  layer: string,
  change: { readonly name?: string; readonly place?: number; readonly contrast?: string },
): Promise<void> {
  await send(`v1/cases/${id}/layers/${layer}`, { method: "PATCH", body: JSON.stringify(change) });
}

export async function deleteLayer(id: string, layer: string): Promise<void> {
  await send(`v1/cases/${id}/layers/${layer}`, { method: "DELETE" });
}

/** A picture of a case; `path` begins with the case's id. */
export async function getPicture(path: string, signal?: AbortSignal): Promise<Blob> {
  return (await send(`v1/cases/${path}`, signal ? { signal } : {})).blob();
}

/** Asks for a file that is made of a JSON body. */
export async function postForFile(path: string, body: unknown): Promise<Blob> {
  const headers = { "content-type": "application/json" };
  return (await send(path, { method: "POST", headers, body: JSON.stringify(body) })).blob();
}

/** Makes a version of a case: of another mask, which is the body, or with other parameters. */
export async function makeVersion(
  id: string,
  parameters: Readonly<Record<string, string>>,
  mask: File | null,
): Promise<Uploaded> {
  const query = new URLSearchParams(parameters);
  const response = await send(`v1/cases/${id}/mask?${query}`, { method: "PUT", ...(mask && { body: mask }) });
  return { created: (await response.json()) as Case, wasThere: response.status === 200 };
}

/** A file of a case, as bytes, of the media type that is wanted. */
export async function getFile(path: string, accept = "*/*"): Promise<Blob> {
  return (await send(`v1/cases/${path}`, { headers: { accept } })).blob();
}

/** The positions that the pixels of a picture show, in LPS mm, and the size of the picture. */
export async function getPositions(
  path: string,
  signal: AbortSignal,
): Promise<{ readonly xyz: Float32Array; readonly size: readonly [number, number] }> {
  const answer = await send(`v1/cases/${path}`, { headers: { accept: "application/octet-stream" }, signal });
  const [width = 0, height = 0] = (answer.headers.get("x-isocortex-size") ?? "").split(",").map(Number);
  return { xyz: new Float32Array(await answer.arrayBuffer()), size: [width, height] };
}

/** Attributes of the DICOM files that a case was made of, by keyword: patient data, asked for only when wanted. */
export async function getDicom(id: string): Promise<Readonly<Record<string, string>>> {
  return (await ask<{ attributes?: Record<string, string> }>(`v1/cases/${id}/dicom`)).attributes ?? {};
}

interface UploadProgress {
  readonly loaded: number;
  readonly total: number;
}

/** What became of an upload. */
export interface Uploaded<Made = Case> {
  readonly created: Made;
  /** Whether the same slices, mask and parameters were a case already. */
  readonly wasThere: boolean;
}

/** Hears how far a form is sent. */
export type Observe = (progress: UploadProgress) => void;

/** Uploads a form and resolves to the case, or layer, that it makes; `observe` gets the bytes sent, which fetch cannot report. */
export async function upload<Made>(
  path: string,
  form: FormData,
  signal: AbortSignal,
  observe: Observe,
): Promise<Uploaded<Made>> {
  for (;;) {
    const sent = token;
    try {
      return await postForm(path, form, signal, observe);
    } catch (error) {
      if (!(await tokenEntered(error, sent))) throw error;
    }
  }
}

function postForm<Made>(path: string, form: FormData, signal: AbortSignal, observe: Observe): Promise<Uploaded<Made>> {
  return new Promise((resolve, reject) => {
    const request = new XMLHttpRequest();
    request.open("POST", path);
    for (const [name, value] of Object.entries(authorization())) request.setRequestHeader(name, value);
    request.upload.onprogress = ({ loaded, total, lengthComputable }) => lengthComputable && observe({ loaded, total });
    request.onerror = () => reject(new Problem(0, "upload-cut-off", ""));
    request.onabort = () => reject(signal.reason as Error);
    request.onload = () => {
      if (request.status >= 200 && request.status < 300) {
        return resolve({ created: JSON.parse(request.responseText) as Made, wasThere: request.status === 200 });
      }
      reject(problemFrom(request.status, { get: (name) => request.getResponseHeader(name) }, request.responseText));
    };
    signal.addEventListener("abort", () => request.abort(), { once: true });
    request.send(form);
  });
}
