//! What the claims of a token permit.

use std::collections::{BTreeMap, BTreeSet};

use serde_json::Value;

use super::keys::Claims;
use crate::scopes::{Role, Scope};

/// How roles are read from the claims of a token.
#[derive(Debug, Clone)]
pub struct RoleRules {
    /// The claim with the roles or the groups of a person. `a.b` is the member `b` of the claim `a`, unless there is a claim `a.b`.
    pub claim: String,
    /// The role of each value of the claim. If this is empty, the values are the names of roles.
    pub roles: BTreeMap<String, Role>,
}

impl RoleRules {
    /// What somebody may do: what any of the roles permits.
    pub(super) fn scopes(&self, claims: &Claims) -> BTreeSet<Scope> {
        scopes_of(&self.roles, &values_of(&self.claim, claims))
    }
}

/// What the roles or groups of somebody permit, by a table of the role of each. If it is empty, they are the names of roles.
pub(crate) fn scopes_of(roles: &BTreeMap<String, Role>, words: &[&str]) -> BTreeSet<Scope> {
    let role = |word: &&str| match roles.is_empty() {
        true => word.parse().ok(),
        false => roles.get(*word).copied(),
    };
    let roles = words.iter().filter_map(role);
    roles.flat_map(Role::scopes).copied().collect()
}

/// The values of a claim, which may be the member of another one.
fn values_of<'a>(claim: &str, claims: &'a Claims) -> Vec<&'a str> {
    let mut parts = claim.split('.');
    let nested = || {
        let first = claims.get(parts.next()?)?;
        parts.try_fold(first, |value, part| value.get(part))
    };
    let value = claims.get(claim).or_else(nested);
    value.map(words).unwrap_or_default()
}

/// The texts of a list, or the words of a text.
fn words(value: &Value) -> Vec<&str> {
    match value {
        Value::String(text) => text.split_ascii_whitespace().collect(),
        Value::Array(all) => all.iter().filter_map(Value::as_str).collect(),
        _ => Vec::new(),
    }
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;

    fn scopes(claim: &str, roles: &[(&str, Role)], claims: &Value) -> Vec<Scope> {
        let rules = RoleRules {
            claim: claim.to_owned(),
            roles: roles
                .iter()
                .map(|&(name, role)| (name.to_owned(), role))
                .collect(),
        };
        let claims = claims.as_object().unwrap();
        rules.scopes(claims).into_iter().collect()
    }

    #[test]
    fn roles_are_sets_of_scopes_which_add_up() {
        let claims = json!({"roles": ["viewer", "pacs", "surgeon"]});
        assert_eq!(
            scopes("roles", &[], &claims),
            [Scope::Read, Scope::DicomStore]
        );
        let claims = json!({"scope": "openid editor"});
        assert_eq!(
            scopes("scope", &[], &claims),
            [Scope::Read, Scope::Write, Scope::Results]
        );
    }

    #[test]
    fn with_a_table_only_its_values_count() {
        let table = [("brain-readers", Role::Viewer)];
        let claims = json!({"groups": ["admin", "brain-readers"]});
        assert_eq!(scopes("groups", &table, &claims), [Scope::Read]);
        let claims = json!({"groups": ["admin"]});
        assert_eq!(scopes("groups", &table, &claims), []);
    }

    #[test]
    fn a_claim_may_be_nested_or_have_points_in_its_name() {
        let nested = json!({"realm_access": {"roles": ["viewer"]}});
        assert_eq!(scopes("realm_access.roles", &[], &nested), [Scope::Read]);
        let plain = json!({"https://site.example/roles": ["viewer"]});
        assert_eq!(
            scopes("https://site.example/roles", &[], &plain),
            [Scope::Read]
        );
    }

    #[test]
    fn what_is_no_list_of_roles_permits_nothing() {
        for value in [
            json!(null),
            json!(true),
            json!({"admin": true}),
            json!([1, ["admin"]]),
            json!("Admin"),
        ] {
            assert_eq!(scopes("roles", &[], &json!({"roles": value})), []);
            assert_eq!(scopes("roles.admin", &[], &json!({"roles": value})), []);
        }
        assert_eq!(scopes("roles", &[], &json!({})), []);
    }
}
