//! What the claims of a token permit, and in which project.

use std::collections::{BTreeMap, BTreeSet};

use case::Project;
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

/// How the project of a person is read from the claims of a token.
#[derive(Debug, Clone, Default)]
pub struct ProjectRules {
    /// The claim with the projects or the groups of a person, as [`RoleRules::claim`].
    pub claim: String,
    /// The project of each value of the claim. If this is empty, everybody belongs to the project without a name.
    pub projects: BTreeMap<String, Project>,
}

/// The project of a person.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Found {
    One(Project),
    None,
    Several,
}

impl ProjectRules {
    pub(super) fn project(&self, claims: &Claims) -> Found {
        project_of(&self.projects, &values_of(&self.claim, claims))
    }
}

/// The project of somebody with these groups, by a table of the project of each. If it is empty, everybody belongs to the project without a name.
pub(crate) fn project_of(projects: &BTreeMap<String, Project>, words: &[&str]) -> Found {
    if projects.is_empty() {
        return Found::One(Project::DEFAULT);
    }
    let named: BTreeSet<_> = words
        .iter()
        .filter_map(|&word| projects.get(word))
        .collect();
    match named.len() {
        0 => Found::None,
        1 => named.first().map_or(Found::None, |&&one| Found::One(one)),
        _ => Found::Several,
    }
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
    fn a_person_belongs_to_one_project_or_gets_nothing() {
        let [one, two] = ["one", "two"].map(|name| Project::parse(name).unwrap());
        let rules = ProjectRules {
            claim: "groups".to_owned(),
            projects: [("/one", one), ("/also-one", one), ("/two", two)]
                .map(|(group, project)| (group.to_owned(), project))
                .into(),
        };
        let found = |rules: &ProjectRules, groups: Value| {
            rules.project(json!({ "groups": groups }).as_object().unwrap())
        };
        assert_eq!(found(&rules, json!(["/one", "/x"])), Found::One(one));
        assert_eq!(found(&rules, json!(["/one", "/also-one"])), Found::One(one));
        assert_eq!(found(&rules, json!(["/one", "/two"])), Found::Several);
        assert_eq!(found(&rules, json!(["/x"])), Found::None);
        assert_eq!(found(&rules, json!(null)), Found::None);
        let default = ProjectRules::default();
        assert_eq!(
            found(&default, json!(["/one"])),
            Found::One(Project::DEFAULT)
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
