//! The HTML around the content of each page.

const PAGE: &str = include_str!("../../site/page.html");

/// Wraps `body` in a page whose folder lies `depth` folders below that of the site.
pub fn framed(title: &str, depth: usize, body: &str) -> String {
    let root = "../".repeat(depth);
    let nav = match depth {
        0 => String::new(),
        _ => format!(
            "<nav aria-label=\"Site\"><a href=\"{root}index.html\">Anyface</a> · \
             <a href=\"{root}docs/index.html\">Documents</a></nav>\n"
        ),
    };
    let page = PAGE.replace("@NAV@\n", &nav).replace("@ROOT@", &root);
    page.replace("@TITLE@", title).replace("@BODY@", body)
}

/// A page of links in the form that pip reads.
pub fn list(title: &str, links: &str) -> String {
    format!(
        "<!DOCTYPE html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\">\n<meta name=\"pypi:repository-version\" \
         content=\"1.0\">\n<title>{title}</title>\n</head>\n<body>\n<h1>{title}</h1>\n{links}\n</body>\n</html>\n"
    )
}
