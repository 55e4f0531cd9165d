//! The keys of an issuer, and whether it has signed a token. `ring` verifies, which TLS uses too.

use jsonwebtoken::crypto::{CryptoProvider, JwtVerifier, KeyUtils};
use jsonwebtoken::errors::{Error, ErrorKind};
use jsonwebtoken::jwk::{AlgorithmParameters, EllipticCurve, Jwk, KeyOperations, PublicKeyUse};
use jsonwebtoken::signature::{self, Verifier};
use jsonwebtoken::{Algorithm, DecodingKey, DecodingKeyKind, Validation, decode};
use ring::signature::{
    ECDSA_P256_SHA256_FIXED, ED25519, RSA_PKCS1_2048_8192_SHA256, RSA_PSS_2048_8192_SHA256,
    RsaPublicKeyComponents, UnparsedPublicKey,
};
use serde_json::{Map, Value};

/// The keys of one issuer that are used.
const MOST_KEYS: usize = 64;

/// The claims of a token.
pub(super) type Claims = Map<String, Value>;

/// A key, with the algorithms that it may be used with: a token cannot choose another one.
#[derive(Debug, Clone)]
pub(super) struct Key {
    id: Option<String>,
    algorithms: Vec<Algorithm>,
    key: DecodingKey,
}

impl Key {
    /// The keys of a set (RFC 7517) that sign by an algorithm that is accepted. Others are left out.
    pub(super) fn all_of(set: &Value) -> Vec<Self> {
        let keys = set["keys"].as_array().into_iter().flatten();
        keys.filter_map(Self::read).take(MOST_KEYS).collect()
    }

    fn read(key: &Value) -> Option<Self> {
        let key: Jwk = serde_json::from_value(key.clone()).ok()?;
        let signs = matches!(
            key.common.public_key_use,
            None | Some(PublicKeyUse::Signature)
        );
        let operations = key.common.key_operations.as_ref();
        let verifies = operations.is_none_or(|all| all.contains(&KeyOperations::Verify));
        let algorithms: &[Algorithm] = match &key.algorithm {
            AlgorithmParameters::RSA(_) => &[Algorithm::RS256, Algorithm::PS256],
            AlgorithmParameters::EllipticCurve(key) if key.curve == EllipticCurve::P256 => {
                &[Algorithm::ES256]
            }
            AlgorithmParameters::OctetKeyPair(key) if key.curve == EllipticCurve::Ed25519 => {
                &[Algorithm::EdDSA]
            }
            _ => &[],
        };
        let stated = key.common.key_algorithm.map(|name| name.to_string());
        let is_stated = |algorithm: &&Algorithm| {
            let name = format!("{algorithm:?}");
            stated.as_ref().is_none_or(|stated| *stated == name)
        };
        let algorithms: Vec<_> = algorithms.iter().filter(is_stated).copied().collect();
        let is_used = signs && verifies && !algorithms.is_empty();
        is_used.then_some(Self {
            key: DecodingKey::from_jwk(&key).ok()?,
            id: key.common.key_id,
            algorithms,
        })
    }

    /// Whether a token could name this key. One without an id may be of any key.
    pub(super) fn is_named(&self, id: Option<&str>) -> bool {
        id.is_none() || self.id.as_deref() == id
    }

    /// The claims of a token that this key has signed, if they are as they must be.
    pub(super) fn open(
        &self,
        token: &str,
        algorithm: Algorithm,
        rules: &Validation,
    ) -> Result<Claims, ErrorKind> {
        if !self.algorithms.contains(&algorithm) {
            return Err(ErrorKind::InvalidAlgorithm);
        }
        install();
        let rules = Validation {
            algorithms: vec![algorithm],
            ..rules.clone()
        };
        let token = decode(token, &self.key, &rules).map_err(Error::into_kind)?;
        Ok(token.claims)
    }
}

/// Lets `jsonwebtoken` use `ring`.
fn install() {
    static PROVIDER: CryptoProvider = CryptoProvider {
        // Nothing is signed here.
        signer_factory: |_, _| Err(ErrorKind::UnsupportedAlgorithm.into()),
        verifier_factory: |algorithm, key| {
            Ok(Box::new(ByRing {
                algorithm: *algorithm,
                key: key.clone(),
            }))
        },
        key_utils: KeyUtils::new_unimplemented(),
    };
    // It is an error to do so again.
    let _ = PROVIDER.install_default();
}

struct ByRing {
    algorithm: Algorithm,
    key: DecodingKey,
}

impl JwtVerifier for ByRing {
    fn algorithm(&self) -> Algorithm {
        self.algorithm
    }
}

impl Verifier<Vec<u8>> for ByRing {
    fn verify(&self, message: &[u8], signature: &Vec<u8>) -> Result<(), signature::Error> {
        let is_right = match (self.key.kind(), self.algorithm) {
            (DecodingKeyKind::RsaModulusExponent { n, e }, algorithm) => {
                let scheme = match algorithm {
                    Algorithm::RS256 => &RSA_PKCS1_2048_8192_SHA256,
                    Algorithm::PS256 => &RSA_PSS_2048_8192_SHA256,
                    _ => return Err(signature::Error::new()),
                };
                RsaPublicKeyComponents { n, e }.verify(scheme, message, signature)
            }
            (DecodingKeyKind::SecretOrDer(key), Algorithm::ES256) => {
                UnparsedPublicKey::new(&ECDSA_P256_SHA256_FIXED, key).verify(message, signature)
            }
            (DecodingKeyKind::SecretOrDer(key), Algorithm::EdDSA) => {
                UnparsedPublicKey::new(&ED25519, key).verify(message, signature)
            }
            _ => return Err(signature::Error::new()),
        };
        is_right.map_err(|_| signature::Error::new())
    }
}

#[cfg(test)]
mod tests {
    use base64::Engine as _;
    use base64::prelude::BASE64_URL_SAFE_NO_PAD as BASE64;
    use jsonwebtoken::decode_header;
    use ring::rand::SystemRandom;
    use ring::signature::{
        ECDSA_P256_SHA256_FIXED_SIGNING, EcdsaKeyPair, Ed25519KeyPair, KeyPair as _,
    };
    use serde_json::json;

    use super::*;

    // The modulus of an RSA key of 2048 bits, and tokens that end in 2100; nobody has the private key any more.
    const MODULUS: &str = "k88tYxmrAP5YVUIsZjdTdb4SN4THsneL9hIGJKdnsBULVC4vFbxeJZpEkKX_vdmwh-wVikYT2PDekLj5MudusYWSAtJvDaNdsUyO\
        gV4PhkL_Df5-8ugn0WUB4lZPpK1I9Ns6mEIeV0VB3ScMsplSaVkMbe7F4J5pPpXy_-nO36YDX-Y0TZgRL52FGo8FUhI-6zimN5D1\
        Lo0453DWZce-q7-3yF0mezg9evNLTHrJ32SRhcH4bSJ_Qlpqu0QB6j6OCkmCI55h4hvL93MhG7WRaiU97vKHN8LZw5vqV3w_bZHB\
        GM1pg_fryL8OmydEqAII_bQup3iCe4z1glbSRoxyVQ";
    const BY_RS256: &str = "eyJhbGciOiJSUzI1NiIsImtpZCI6InIifQ.eyJpc3MiOiJodHRwczovL2lzc3Vlci5leGFtcGxlIiwiYXVkIjoiaXNvY29ydGV4I\
        iwic3ViIjoidS0xIiwiZXhwIjo0MTAyNDQ0ODAwfQ.iM90wW7MSe8CApVvE8_CGxXIdOfissf5tPy8_1RRdg4Hwe7k_hS1Hxl-te\
        fefqe-jPZJGvJkRkoNzGQ1efFkR7U2d08brdtgYXHTTcceC-C3Y9EOaQc3k4_CtYuhEf2IolmtrbksLniY-MqVh7rlFVnFCkILz6\
        oMG55z3eDdXvPiXs2ZAYSzjHBXdvxAI0MOUZrH6eRAy19eTAEmzOkdfkO_rNEwjCft93vxZD-VnjD3bPUWTtYMfBc6NaWJgZFEfA\
        dR5yEpF0FV60RifbSAeBoWEzOgmYKf0NJWFjxAESaf7R_9EqviYh0Fmg_XafAjJ9EZAd5bjsfa5EahqecI4g";
    const BY_PS256: &str = "eyJhbGciOiJQUzI1NiIsImtpZCI6InIifQ.eyJpc3MiOiJodHRwczovL2lzc3Vlci5leGFtcGxlIiwiYXVkIjoiaXNvY29ydGV4I\
        iwic3ViIjoidS0xIiwiZXhwIjo0MTAyNDQ0ODAwfQ.ftUBPcl8lI0uyaZrkKWLlTXe8Mbu86xAslSSQjv492g7ck92MrMPpkROoy\
        tbTxxIhfLpVrRXBGhOc7Vfi-fORopetFpN_GMGsrfZLBOrO3591kyyTx-iqeA1nRgK1uCMSGRJ2O8l0O8tIGLQgFF6xz8M_PNBai\
        wZddhxyF4OyPe_Y8WNRFdQpn6v9Df9MTFUFrnT-K-w3VZ8ya0sYAzfgvtoi37TaGwuupf7abTd-2alxdqwXI3ol3U2rjnONGvUcB\
        vijVrDqZcCFe93MHqNJ2PILVAeKGdWUwhVlGC0vW5jEP0E-aFaiqB8hYWCLo7mh6aGVh1rF8P6Wit9GWPgmA";
    // The same of 1024 bits.
    const SHORT_MODULUS: &str = "z950_q3dxg8AY1MiUWGxw4MiapEmnj02Myz_cw0PVTJf7ZTq5y69L37Qp9_EkJcc--qLpByX_5Bpl37U1j93ipz7kZc88n1Vwmsh\
        3_W-9YCcLoWo_0ClltEpCUJcK3JXOXMl7WBBzPGT6X9BQW2gZpoJXmVAnQOq5c6qcrlHAXU";
    const BY_SHORT: &str = "eyJhbGciOiJSUzI1NiIsImtpZCI6InIifQ.eyJpc3MiOiJodHRwczovL2lzc3Vlci5leGFtcGxlIiwiYXVkIjoiaXNvY29ydGV4I\
        iwic3ViIjoidS0xIiwiZXhwIjo0MTAyNDQ0ODAwfQ.SKXn96kdOIB7lrZSLtsIVW2cTDH-ICo2VbnZ7yW-xtJ0vC2LJ-fb3Tkgkx\
        hj1kLmDIH-_CmC4BsViAZfkQtrTCOrZLdtrOGPlE9ItznKIlqcYcchH0gYrAE6b5yPq0pFuBPHxrPYqqpHuxyUqG_IHI2Kzz59dV\
        E0AWMF5u815F8";

    fn rules() -> Validation {
        let mut rules = Validation::default();
        rules.set_audience(&["isocortex"]);
        rules.set_issuer(&["https://issuer.example"]);
        rules
    }

    fn only(key: Value) -> Vec<Key> {
        Key::all_of(&json!({"keys": [key]}))
    }

    fn rsa(modulus: &str, further: &Value) -> Vec<Key> {
        let mut key = json!({"kty": "RSA", "kid": "r", "n": modulus, "e": "AQAB"});
        let further = further.as_object().unwrap().clone();
        key.as_object_mut().unwrap().extend(further);
        only(key)
    }

    fn opens(keys: &[Key], token: &str) -> Result<(), ErrorKind> {
        let algorithm = decode_header(token).unwrap().alg;
        let key = keys.first().ok_or(ErrorKind::InvalidKeyFormat)?;
        key.open(token, algorithm, &rules()).map(|claims| {
            assert_eq!(claims["sub"], "u-1");
        })
    }

    fn unsigned(header: &Value) -> String {
        let claims = json!({"iss": "https://issuer.example", "aud": "isocortex", "sub": "u-1", "exp": 4_102_444_800_u64});
        let [header, claims] = [header, &claims].map(|part| BASE64.encode(part.to_string()));
        format!("{header}.{claims}")
    }

    fn signed(header: &Value, sign: impl Fn(&[u8]) -> Vec<u8>) -> String {
        let text = unsigned(header);
        let signature = BASE64.encode(sign(text.as_bytes()));
        format!("{text}.{signature}")
    }

    #[test]
    fn what_a_key_has_signed_opens() {
        let key = rsa(MODULUS, &json!({}));
        assert!(opens(&key, BY_RS256).is_ok());
        assert!(opens(&key, BY_PS256).is_ok());
        let random = SystemRandom::new();
        let scheme = &ECDSA_P256_SHA256_FIXED_SIGNING;
        let pair = EcdsaKeyPair::generate_pkcs8(scheme, &random).unwrap();
        let pair = EcdsaKeyPair::from_pkcs8(scheme, pair.as_ref(), &random).unwrap();
        let [x, y] = [1, 33].map(|at| BASE64.encode(&pair.public_key().as_ref()[at..at + 32]));
        let key = only(json!({"kty": "EC", "crv": "P-256", "x": x, "y": y}));
        let token = signed(&json!({"alg": "ES256"}), |text| {
            pair.sign(&random, text).unwrap().as_ref().to_vec()
        });
        assert!(opens(&key, &token).is_ok());
        let pair = Ed25519KeyPair::generate_pkcs8(&random).unwrap();
        let pair = Ed25519KeyPair::from_pkcs8(pair.as_ref()).unwrap();
        let x = BASE64.encode(pair.public_key());
        let key = only(json!({"kty": "OKP", "crv": "Ed25519", "x": x}));
        let token = signed(&json!({"alg": "EdDSA"}), |text| {
            pair.sign(text).as_ref().to_vec()
        });
        assert!(opens(&key, &token).is_ok());
        let (text, _) = token.rsplit_once('.').unwrap();
        let wrong = opens(&key, &format!("{text}.{}", BASE64.encode([7; 64])));
        assert!(
            matches!(wrong, Err(ErrorKind::InvalidSignature)),
            "{wrong:?}"
        );
    }

    #[test]
    fn a_token_cannot_choose_another_algorithm_than_its_key_has() {
        let key = rsa(MODULUS, &json!({"alg": "PS256"}));
        assert!(opens(&key, BY_PS256).is_ok());
        assert!(opens(&key, BY_RS256).is_err());
        // The public key as the secret of an HMAC, in each form that an attacker could mean.
        let key = rsa(MODULUS, &json!({}));
        let modulus = BASE64.decode(MODULUS).unwrap();
        for secret in [&modulus[..], MODULUS.as_bytes(), b""] {
            let hmac = ring::hmac::Key::new(ring::hmac::HMAC_SHA256, secret);
            let token = signed(&json!({"alg": "HS256", "kid": "r"}), |text| {
                ring::hmac::sign(&hmac, text).as_ref().to_vec()
            });
            assert!(opens(&key, &token).is_err());
        }
        for algorithm in ["none", "None", "NONE", "", "RS1"] {
            let token = format!("{}.", unsigned(&json!({"alg": algorithm})));
            assert!(decode_header(token).is_err(), "{algorithm}");
        }
        for algorithm in ["RS384", "RS512", "PS512", "ES384"] {
            let token = format!("{}.AAAA", unsigned(&json!({"alg": algorithm, "kid": "r"})));
            assert!(opens(&key, &token).is_err(), "{algorithm}");
        }
    }

    #[test]
    fn keys_that_are_not_for_signatures_or_too_short_open_nothing() {
        for further in [
            json!({"use": "enc"}),
            json!({"key_ops": ["encrypt"]}),
            json!({"alg": "RSA-OAEP"}),
            json!({"alg": "HS256"}),
        ] {
            assert!(rsa(MODULUS, &further).is_empty(), "{further}");
        }
        assert!(only(json!({"kty": "oct", "k": "c2VjcmV0"})).is_empty());
        assert!(only(json!({"kty": "EC", "crv": "P-384", "x": "AA", "y": "AA"})).is_empty());
        assert!(only(json!({"kty": "RSA"})).is_empty());
        assert!(only(json!("key")).is_empty());
        assert!(rsa(MODULUS, &json!({"use": "sig", "key_ops": ["verify"]})).len() == 1);
        assert!(opens(&rsa(SHORT_MODULUS, &json!({})), BY_SHORT).is_err());
    }
}
