//! Who may ask. A browser runs what other sites tell it to, so an address of this machine is no protection: a page from
//! elsewhere may send requests here (forgery), or give its own name this machine's address (DNS rebinding). Hence:
//!
//! * `Host` must be an address, `localhost` or a name that was permitted; a rebound name is none of these.
//! * `Origin`, where there is one, must be this server; `Sec-Fetch-Site` must not be another site's.
//! * Everything below `/api` asks for the token, if there is one, in a header that no form and no link can send.

use std::net::IpAddr;
use std::sync::Arc;

use axum::extract::{Request, State};
use axum::http::header::{
    AUTHORIZATION, CACHE_CONTROL, CONTENT_SECURITY_POLICY, HOST, HeaderName, ORIGIN, REFERRER_POLICY,
    WWW_AUTHENTICATE, X_CONTENT_TYPE_OPTIONS,
};
use axum::http::uri::Authority;
use axum::http::{HeaderMap, HeaderValue, StatusCode};
use axum::middleware::Next;
use axum::response::{IntoResponse, Response};

use super::Site;
use super::problem::Problem;

/// What the page may do: load its own parts, ask its own server, and nothing else.
const POLICY: &str = "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self'; connect-src 'self'; \
                      base-uri 'none'; form-action 'none'; frame-ancestors 'none'";

/// Refuses requests that another site may have caused, and marks all answers.
pub(super) async fn same_site(State(site): State<Arc<Site>>, request: Request, next: Next) -> Response {
    let mut response = match from_here(request.headers(), &site.hosts) {
        Ok(()) => next.run(request).await,
        Err(problem) => problem.into_response(),
    };
    let headers = response.headers_mut();
    for (name, value) in [
        (CONTENT_SECURITY_POLICY, POLICY),
        (X_CONTENT_TYPE_OPTIONS, "nosniff"),
        (REFERRER_POLICY, "no-referrer"),
        (HeaderName::from_static("cross-origin-opener-policy"), "same-origin"),
        (HeaderName::from_static("cross-origin-resource-policy"), "same-origin"),
    ] {
        headers.insert(name, HeaderValue::from_static(value));
    }
    headers.entry(CACHE_CONTROL).or_insert(HeaderValue::from_static("no-store"));
    response
}

/// Refuses requests of those who do not know the token.
pub(super) async fn token(State(site): State<Arc<Site>>, request: Request, next: Next) -> Response {
    let Some(token) = &site.token else { return next.run(request).await };
    let claimed = request.headers().get(AUTHORIZATION).map(HeaderValue::as_bytes);
    let claimed = claimed.and_then(|value| {
        let (scheme, secret) = value.split_at_checked(7)?;
        scheme.eq_ignore_ascii_case(b"bearer ").then_some(secret)
    });
    if claimed.is_some_and(|claimed| token.is(claimed)) {
        return next.run(request).await;
    }
    let problem = Problem::new(StatusCode::UNAUTHORIZED, "token_needed", "this asks for the server's token")
        .help("send it as `Authorization: Bearer TOKEN`; `ccu serve` has printed it, or was given it");
    ([(WWW_AUTHENTICATE, "Bearer")], problem).into_response()
}

fn from_here(headers: &HeaderMap, hosts: &[String]) -> Result<(), Problem> {
    let mut all = headers.get_all(HOST).iter();
    let host = match (all.next(), all.next()) {
        (Some(host), None) => host.to_str().ok().and_then(|host| host.parse::<Authority>().ok()),
        _ => None,
    };
    let Some(host) = host else {
        return Err(Problem::new(StatusCode::BAD_REQUEST, "no_host", "a request needs one proper `Host`"));
    };
    if !is_ours(host.host(), hosts) {
        let message = format!("this server is not {:?}", host.host());
        let help = "ask for it by address or as localhost, or start it with `--allow-host NAME`";
        return Err(Problem::new(StatusCode::MISDIRECTED_REQUEST, "wrong_host", message).help(help));
    }
    let foreign = |what: &str| {
        let message = format!("{what} says that another site has caused this request");
        Problem::new(StatusCode::FORBIDDEN, "other_site", message)
    };
    for origin in headers.get_all(ORIGIN) {
        let origin = origin.to_str().unwrap_or_default();
        let authority = origin.strip_prefix("http://").or_else(|| origin.strip_prefix("https://"));
        if !authority.is_some_and(|authority| authority.eq_ignore_ascii_case(host.as_str())) {
            return Err(foreign("`Origin`"));
        }
    }
    if headers.get("sec-fetch-site").is_some_and(|from| from != "same-origin" && from != "none") {
        return Err(foreign("`Sec-Fetch-Site`"));
    }
    Ok(())
}

/// The port does not matter: a rebound name has the right one.
fn is_ours(host: &str, hosts: &[String]) -> bool {
    let bare = host.strip_prefix('[').and_then(|host| host.strip_suffix(']')).unwrap_or(host);
    bare.parse::<IpAddr>().is_ok()
        || host.eq_ignore_ascii_case("localhost")
        || hosts.iter().any(|name| host.eq_ignore_ascii_case(name))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn answer(lines: &[(&str, &str)]) -> Result<(), u16> {
        let mut headers = HeaderMap::new();
        for (name, value) in lines {
            let name: HeaderName = name.parse().expect("a name");
            headers.append(name, value.parse().expect("a value"));
        }
        from_here(&headers, &["robot.example".to_owned()])
            .map_err(|problem| problem.into_response().status().as_u16())
    }

    #[test]
    fn hosts_are_addresses_localhost_and_permitted_names() {
        for good in ["127.0.0.1:8748", "[::1]:80", "localhost", "LOCALHOST:1", "192.0.2.7", "Robot.example:9"]
        {
            assert_eq!(answer(&[("host", good)]), Ok(()), "{good}");
        }
        for wrong in
            ["evil.example", "127.0.0.1.evil.example", "localhost.evil.example:8748", "robot.example."]
        {
            assert_eq!(answer(&[("host", wrong)]), Err(421), "{wrong}");
        }
        assert_eq!(answer(&[]), Err(400));
        assert_eq!(answer(&[("host", "localhost"), ("host", "evil.example")]), Err(400));
        assert_eq!(answer(&[("host", "a b")]), Err(400));
    }

    #[test]
    fn other_sites_are_refused() {
        let here = ("host", "localhost:8748");
        for good in ["http://localhost:8748", "https://localhost:8748"] {
            assert_eq!(answer(&[here, ("origin", good)]), Ok(()), "{good}");
        }
        for wrong in
            ["http://evil.example", "http://localhost:8749", "http://localhost", "null", "file://", ""]
        {
            assert_eq!(answer(&[here, ("origin", wrong)]), Err(403), "{wrong}");
        }
        assert_eq!(answer(&[here, ("sec-fetch-site", "none")]), Ok(()));
        for wrong in ["cross-site", "same-site"] {
            assert_eq!(answer(&[here, ("sec-fetch-site", wrong)]), Err(403), "{wrong}");
        }
    }
}
