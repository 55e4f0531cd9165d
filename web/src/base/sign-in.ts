// Signing in and out at an issuer of OpenID Connect: by authorization code with PKCE (RFC 7636). The code comes back in the
// fragment of an address, which no server and no log sees.

import {
  type Issuer,
  type Session,
  claimsOf,
  endOf,
  forgetSession,
  getTokens,
  keepSession,
  session,
} from "./session.ts";

const ATTEMPT = "signing-in";
const SIGNED_OUT = "signed-out";
const CHANNEL = "isocortex-sign-in";

/** A sign-in that was begun. */
interface Attempt {
  readonly issuer: Issuer;
  readonly state: string;
  readonly nonce: string;
  readonly verifier: string;
  /** Where to go afterwards. */
  readonly back: string;
}

/** Why a sign-in came to nothing: the issuer's own word, or one of ours. */
export class NotSignedIn extends Error {}

/** Somebody else has signed in than the page belongs to. */
export class OtherPerson extends Error {
  constructor(
    /** Who has signed in. */
    readonly entered: string,
    readonly owner: string,
  ) {
    super();
  }
}

/** Signing in needs a browser that trusts the way to this server. */
export const canSignIn = (): boolean => isSecureContext;

/** Whether somebody has signed out in this tab. */
export const isSignedOut = (): boolean => sessionStorage.getItem(SIGNED_OUT) !== null;

/** The issuer, if the page signs in by one; or whether a proxy in front of the server signs people in. */
export async function askHowToSignIn(): Promise<Issuer | "proxy" | null> {
  const answer = await fetch("sign-in", { cache: "no-store" });
  const said = answer.ok ? ((await answer.json()) as Partial<Issuer> & { readonly by_proxy?: boolean }) : {};
  if (said.by_proxy) return "proxy";
  return said.issuer ? (said as Issuer) : null;
}

const base64url = (bytes: ArrayBuffer | Uint8Array): string =>
  btoa(String.fromCharCode(...new Uint8Array(bytes)))
    .replace(/\+/g, "-")
    .replace(/\//g, "_")
    .replace(/=/g, "");

const random = (): string => base64url(crypto.getRandomValues(new Uint8Array(32)));

const redirectUri = (): string => new URL("signed-in", document.baseURI).href;

/** Begins a sign-in: what to remember, and the address of the issuer to open. */
export async function begin(issuer: Issuer): Promise<{ readonly attempt: Attempt; readonly address: string }> {
  const [state, nonce, verifier] = [random(), random(), random()];
  const { pathname, search, hash } = location;
  const challenge = await crypto.subtle.digest("SHA-256", new TextEncoder().encode(verifier));
  const query = new URLSearchParams({
    ...issuer.parameters,
    client_id: issuer.client_id,
    code_challenge: base64url(challenge),
    code_challenge_method: "S256",
    nonce,
    redirect_uri: redirectUri(),
    response_mode: "fragment",
    response_type: "code",
    scope: issuer.scope,
    state,
  });
  const address = new URL(issuer.authorization_endpoint);
  for (const [name, value] of query) address.searchParams.set(name, value);
  return { attempt: { issuer, state, nonce, verifier, back: pathname + search + hash }, address: address.href };
}

/** Goes to the issuer, which leads back to where the page is now. */
export async function leaveForIssuer(issuer: Issuer): Promise<never> {
  const { attempt, address } = await begin(issuer);
  sessionStorage.removeItem(SIGNED_OUT);
  sessionStorage.setItem(ATTEMPT, JSON.stringify(attempt));
  location.assign(address);
  return new Promise<never>(() => {});
}

/** The sign-in that this tab has left for, if the answer is to it. It is taken, so that an answer counts once. */
export function takeAttempt(answer: URLSearchParams): Attempt | null {
  try {
    const attempt = JSON.parse(sessionStorage.getItem(ATTEMPT) ?? "null") as Attempt | null;
    if (!attempt || attempt.state !== answer.get("state")) return null;
    sessionStorage.removeItem(ATTEMPT);
    return attempt;
  } catch {
    return null;
  }
}

/** Makes a session of the answer of the issuer to an attempt. */
export async function finish({ issuer, nonce, verifier }: Attempt, answer: URLSearchParams): Promise<Session> {
  const from = answer.get("iss");
  // An answer of another issuer would send our code to this one, or its code to ours (RFC 9207).
  if (from !== null ? from !== issuer.issuer : issuer.names_itself) throw new NotSignedIn("wrong_issuer");
  const code = answer.get("code");
  if (code === null) throw new NotSignedIn(answer.get("error") ?? "no_code");
  const tokens = await getTokens(issuer, {
    grant_type: "authorization_code",
    code,
    code_verifier: verifier,
    redirect_uri: redirectUri(),
  });
  const claims = claimsOf(tokens.id_token ?? "");
  const isOurs = [claims.aud].flat().includes(issuer.client_id) && claims.iss === issuer.issuer;
  if (!isOurs || claims.nonce !== nonce || typeof claims.sub !== "string") throw new NotSignedIn("wrong_id_token");
  const names = [claims.name, claims.preferred_username, claims.email, claims.sub];
  return {
    issuer,
    subject: claims.sub,
    name: String(names.find((name) => typeof name === "string" && name !== "")),
    access: tokens.access_token,
    refresh: tokens.refresh_token ?? "",
    ends: endOf(tokens),
  };
}

/** What a window for signing in leaves to the page that has opened it, and what that answers. */
interface Note {
  readonly answer?: string;
  readonly taken?: string;
}

/**
 * Hands the answer of the issuer to the page that has opened this window; whether one has taken it. The windows do not know each
 * other, because the page shares nothing with windows of other sites.
 */
export function handToOpener(answer: URLSearchParams, patience_ms: number): Promise<boolean> {
  const channel = new BroadcastChannel(CHANNEL);
  return new Promise<boolean>((resolve) => {
    channel.onmessage = ({ data }: MessageEvent<Note>) => data.taken === answer.get("state") && resolve(true);
    setTimeout(() => resolve(false), patience_ms);
    channel.postMessage({ answer: String(answer) } satisfies Note);
  }).finally(() => channel.close());
}

/** Waits for the answer of the issuer that a window of this attempt gets. */
export function answerFromWindow(attempt: Attempt, signal: AbortSignal): Promise<URLSearchParams> {
  const channel = new BroadcastChannel(CHANNEL);
  return new Promise<URLSearchParams>((resolve, reject) => {
    channel.onmessage = ({ data }: MessageEvent<Note>) => {
      const answer = new URLSearchParams(data.answer ?? "");
      if (answer.get("state") !== attempt.state) return;
      channel.postMessage({ taken: attempt.state } satisfies Note);
      resolve(answer);
    };
    signal.addEventListener("abort", () => reject(signal.reason as Error), { once: true });
  }).finally(() => channel.close());
}

/** Keeps a session; the tab is signed in from now on. */
export function enter(entered: Session): void {
  sessionStorage.removeItem(SIGNED_OUT);
  keepSession(entered);
}

/** How long to wait for the issuer to take a token back, in ms. */
const REVOKE_MS = 2000;

/** Ends the session here and at the issuer, and leaves the page. */
export async function signOut(): Promise<void> {
  const ended = session();
  forgetSession();
  sessionStorage.setItem(SIGNED_OUT, "yes");
  const home = new URL("./", document.baseURI).href;
  if (!ended) return location.assign(home);
  const { client_id, revocation_endpoint, end_session_endpoint } = ended.issuer;
  if (revocation_endpoint && ended.refresh) {
    const body = new URLSearchParams({ client_id, token: ended.refresh, token_type_hint: "refresh_token" });
    const signal = AbortSignal.timeout(REVOKE_MS);
    await fetch(revocation_endpoint, { method: "POST", body, credentials: "omit", signal }).catch(() => {});
  }
  if (!end_session_endpoint) return location.assign(home);
  const address = new URL(end_session_endpoint);
  // Without the ID token, which must be in no address, the issuer may ask whether it is meant.
  address.searchParams.set("client_id", client_id);
  address.searchParams.set("post_logout_redirect_uri", home);
  location.assign(address);
}
