//! Checks of what users have chosen for themselves.

use super::Subject;
use crate::sql::preferences::UserPreferences;

pub(crate) async fn preferences_are_of_one_user_and_replaced_by_whoever_knows_them(
    subject: &Subject,
) {
    let store = &subject.store;
    let of = async |user: &str| store.preferences(user).await.unwrap();
    let replace = async |user: &str, known: Option<&str>, document: Option<&str>| {
        let replaced = store.replace_preferences(user, known, document);
        replaced.await.unwrap()
    };
    assert_eq!(of("proxy:ana").await, None);
    assert!(replace("proxy:ana", None, Some("{}")).await);
    assert!(!replace("proxy:ana", None, Some("late")).await);
    assert!(replace("proxy:ana", Some("{}"), Some("ação")).await);
    assert!(!replace("proxy:ana", Some("{}"), None).await);
    assert!(replace("ben", None, Some("ben")).await);
    assert_eq!(of("proxy:ana").await.as_deref(), Some("ação"));
    assert_eq!(of("ben").await.as_deref(), Some("ben"));
    let users = async || {
        let all = store.all_preferences().await.unwrap().into_iter();
        all.map(|one| one.user).collect::<Vec<_>>()
    };
    assert_eq!(users().await, ["ben", "proxy:ana"]);
    assert!(replace("proxy:ana", Some("ação"), None).await);
    assert!(replace("proxy:ana", None, None).await, "it is gone already");
    assert_eq!(of("proxy:ana").await, None);
    assert_eq!(users().await, ["ben"]);

    let ben = store.all_preferences().await.unwrap().remove(0);
    let copied = async |document: &str, later: i64| {
        let document = document.to_owned();
        let changed_at = ben.changed_at + later;
        let user = ben.user.clone();
        let one = UserPreferences {
            user,
            document,
            changed_at,
        };
        store.write_copied_preferences(one).await.unwrap();
        of("ben").await.unwrap()
    };
    assert_eq!(copied("before", -1).await, "ben");
    assert_eq!(copied("at the same time", 0).await, "ben");
    assert_eq!(copied("since", 1).await, "since");
    assert_eq!(copied("between", 0).await, "since", "its time comes along");
}
