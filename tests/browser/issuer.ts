// A real issuer of OpenID Connect on this machine: oidc-provider, whose own pages take any name and any password.

import { type Server as Listener, createServer } from "node:http";
import type { AddressInfo } from "node:net";

/** What the tokens are for. */
export const AUDIENCE = "urn:isocortex:test";

/** The part of oidc-provider that is used, which has no types. */
interface Provider {
  callback(): Parameters<typeof createServer>[1] & object;
}

export interface Issuer {
  readonly address: string;
  /** Begins to answer for the page of a server. */
  serve(page: string): Promise<void>;
  stop(): Promise<void>;
}

/** Takes a port; it answers once the address of the page is known, which it lets people back to. */
export async function startIssuer(): Promise<Issuer> {
  const listener: Listener = createServer();
  await new Promise<void>((resolve) => listener.listen(0, "127.0.0.1", resolve));
  const address = `http://127.0.0.1:${(listener.address() as AddressInfo).port}`;
  return {
    address,
    async serve(page) {
      const library = (await import("oidc-provider" as string)) as {
        default: new (issuer: string, options: unknown) => Provider;
      };
      listener.on("request", new library.default(address, options(page)).callback());
    },
    async stop() {
      listener.closeAllConnections();
      await new Promise((resolve) => listener.close(resolve));
    },
  };
}

const options = (page: string): unknown => ({
  clients: [
    {
      client_id: "page",
      token_endpoint_auth_method: "none",
      grant_types: ["authorization_code", "refresh_token"],
      redirect_uris: [new URL("signed-in", page).href],
      post_logout_redirect_uris: [new URL("./", page).href],
    },
  ],
  claims: { openid: ["sub"], profile: ["name"] },
  conformIdTokenClaims: false,
  clientBasedCORS: (_context: unknown, origin: string) => origin === new URL(page).origin,
  cookies: { keys: ["a key of this test"] },
  issueRefreshToken: async () => true,
  findAccount: async (_context: unknown, accountId: string) => ({
    accountId,
    claims: async () => ({ sub: accountId, name: `Dr. ${accountId}` }),
  }),
  extraTokenClaims: async (_context: unknown, token: { readonly accountId?: string }) => ({
    groups: token.accountId?.startsWith("guest") ? [] : ["readers"],
  }),
  features: {
    revocation: { enabled: true },
    resourceIndicators: {
      enabled: true,
      defaultResource: async () => AUDIENCE,
      useGrantedResource: async () => true,
      getResourceServerInfo: async () => ({
        scope: "",
        audience: AUDIENCE,
        accessTokenFormat: "jwt",
        accessTokenTTL: 3600,
        jwt: { sign: { alg: "RS256" } },
      }),
    },
  },
});
