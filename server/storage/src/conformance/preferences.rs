//! Checks of what users have chosen for themselves.

use super::Subject;

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
    let users = store.users_with_preferences().await.unwrap();
    assert_eq!(users, ["ben", "proxy:ana"]);
    assert!(replace("proxy:ana", Some("ação"), None).await);
    assert!(replace("proxy:ana", None, None).await, "it is gone already");
    assert_eq!(of("proxy:ana").await, None);
    assert_eq!(store.users_with_preferences().await.unwrap(), ["ben"]);
}
