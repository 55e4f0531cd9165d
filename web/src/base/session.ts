// The session of somebody who has signed in at an issuer. It lies in the storage of the tab, so that reloading keeps it and the
// frames of the page share it; it ends with the tab.

const KEY = "session";

/** Where and how the page signs in, as the server says. */
export interface Issuer {
  readonly issuer: string;
  readonly client_id: string;
  readonly authorization_endpoint: string;
  readonly token_endpoint: string;
  readonly end_session_endpoint?: string;
  readonly revocation_endpoint?: string;
  readonly scope: string;
  readonly parameters: Readonly<Record<string, string>>;
  /** Whether the issuer names itself when it sends somebody back. */
  readonly names_itself: boolean;
}

export interface Session {
  readonly issuer: Issuer;
  /** Who has signed in, as the issuer knows them. */
  readonly subject: string;
  /** The same for people. */
  readonly name: string;
  readonly access: string;
  /** Gets the next token; empty if the issuer gave none. */
  readonly refresh: string;
  /** When the token ends, in ms; Infinity if the issuer did not say. */
  readonly ends: number;
}

/** A token that ends within this time is renewed before it is used. */
const SOON_MS = 30_000;

export function session(): Session | null {
  try {
    return JSON.parse(sessionStorage.getItem(KEY) ?? "null", (name, value: unknown) =>
      name === "ends" && value === null ? Infinity : value,
    ) as Session | null;
  } catch {
    return null;
  }
}

export const keepSession = (kept: Session): void => sessionStorage.setItem(KEY, JSON.stringify(kept));

export const forgetSession = (): void => sessionStorage.removeItem(KEY);

/** What an issuer answers where tokens are asked for. */
interface Tokens {
  readonly access_token: string;
  readonly id_token?: string;
  readonly refresh_token?: string;
  readonly expires_in?: number;
}

/** Why the issuer gave no tokens: its word, such as `invalid_grant`, or empty if it did not answer. */
export class NoTokens extends Error {}

/** Asks an issuer for tokens. */
export async function getTokens(
  { token_endpoint, client_id, parameters }: Issuer,
  grant: Readonly<Record<string, string>>,
): Promise<Tokens> {
  const body = new URLSearchParams({ ...parameters, client_id, ...grant });
  let answer: Response;
  try {
    answer = await fetch(token_endpoint, { method: "POST", body, credentials: "omit", redirect: "error" });
  } catch {
    throw new NoTokens("");
  }
  const said = (await answer.json().catch(() => ({}))) as Partial<Tokens> & { readonly error?: unknown };
  if (!answer.ok || typeof said.access_token !== "string") throw new NoTokens(String(said.error ?? answer.status));
  return said as Tokens;
}

/** The claims of an ID token that came from its issuer itself, by TLS: nobody else can have made it. */
export function claimsOf(token: string): Readonly<Record<string, unknown>> {
  const base64 = (token.split(".")[1] ?? "").replace(/-/g, "+").replace(/_/g, "/");
  const bytes = Uint8Array.from(atob(base64), (letter) => letter.charCodeAt(0));
  return JSON.parse(new TextDecoder().decode(bytes)) as Record<string, unknown>;
}

export const endOf = ({ expires_in }: Tokens): number =>
  expires_in === undefined ? Infinity : Date.now() + 1000 * expires_in;

/** Gets the next token if the one that is there ends soon, or was refused. */
export async function renewed(refused = ""): Promise<void> {
  const isStale = (now: Session | null): now is Session =>
    now !== null && now.refresh !== "" && (refused === now.access || now.ends - Date.now() < SOON_MS);
  if (!isStale(session())) return;
  // A refresh token is used once: the frames of the page take turns, and look again when it is theirs.
  await navigator.locks.request("isocortex-session", async () => {
    const now = session();
    if (!isStale(now)) return;
    try {
      const tokens = await getTokens(now.issuer, { grant_type: "refresh_token", refresh_token: now.refresh });
      const { access_token: access, refresh_token: refresh = now.refresh } = tokens;
      keepSession({ ...now, access, refresh, ends: endOf(tokens) });
    } catch (problem) {
      // An issuer that does not answer is asked again next time; one that refuses is not.
      if (problem instanceof NoTokens && problem.message !== "") keepSession({ ...now, refresh: "" });
    }
  });
}
