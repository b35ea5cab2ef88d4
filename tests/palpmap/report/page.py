"""What stands on an HTML page."""

from html.parser import HTMLParser

VOID = ("meta", "img", "br", "link", "hr", "input")


class Page(HTMLParser):
    """Tags, links, text, headings and table rows; fails on a tag that is not closed rightly."""

    def __init__(self, text):
        super().__init__()
        self.tags, self.links, self.text, self.headings, self.rows = [], [], "", [], []
        self._open = []
        self.feed(text)
        self.close()
        assert self._open == []

    def handle_starttag(self, tag, attrs):
        self.tags.append(tag)
        self.links += [v for k, v in attrs if k in ("src", "href", "srcset", "action")]
        if tag not in VOID:
            self._open.append(tag)
        if tag == "tr":
            self.rows.append([])
        elif tag in ("td", "th"):
            self.rows[-1].append("")
        elif tag == "h2":
            self.headings.append("")

    def handle_endtag(self, tag):
        assert self._open.pop() == tag

    def handle_data(self, data):
        if "style" not in self._open:
            self.text += data
        if "h2" in self._open:
            self.headings[-1] += data
        elif {"td", "th"} & set(self._open):
            self.rows[-1][-1] += data
