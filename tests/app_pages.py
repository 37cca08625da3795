"""A page of the app on a free port of the loopback, for tests, and requests to it."""

import http.client
import json
import re
import signal
import threading
import time
import uuid
from contextlib import contextmanager
from pathlib import Path
from urllib.parse import quote

import uvicorn
from fitmodels import cli
from fitmodels.app.guard import LARGEST, START, Guard
from fitmodels.app.page import Page
from fitmodels.app.project import Project
from fitmodels.app.server import listening


class Client:
    """Requests of a browser that knows the token."""

    def __init__(self, port, token, page):
        self.port, self.token, self.page = port, token, page
        self.host = f"127.0.0.1:{port}"
        status, headers, _ = self.ask("GET", START + token)
        assert status == 303
        self.cookie = headers["set-cookie"].split(";")[0]

    def ask(self, method, path, body=None, **headers):
        """Status, headers and text of an answer; with the cookie unless ``cookie`` is given."""
        known = {"Host": self.host, "Cookie": getattr(self, "cookie", "")}
        if method == "POST":
            known |= {"Origin": f"http://{self.host}", "Content-Type": "application/x-www-form-urlencoded"}
        given = {name.replace("_", "-").title(): value for name, value in headers.items()}
        connection = http.client.HTTPConnection("127.0.0.1", self.port, timeout=60)
        try:
            connection.request(method, path, body, {k: v for k, v in {**known, **given}.items() if v is not None})
            answer = connection.getresponse()
            return (
                answer.status,
                {k.lower(): v for k, v in answer.getheaders()},
                answer.read().decode("utf-8", "replace"),
            )
        finally:
            connection.close()

    def get(self, path):
        """Text of a page."""
        status, _, text = self.ask("GET", path)
        assert status == 200, (status, text[:500])
        return text

    def post(self, path, **fields):
        """Status and text of the answer to a form."""
        body = "&".join(f"{name}={quote(value, safe='')}" for name, value in fields.items())
        status, _, text = self.ask("POST", path, body)
        return status, text

    def upload(self, name, content):
        """Status and address of the answer to a file."""
        status, headers, text = self.send("/files", "file", name, content)
        return status, headers.get("location", text)

    def send(self, path, field, name, content):
        """Answer to a form with a file."""
        mark = uuid.uuid4().hex
        head = f'--{mark}\r\nContent-Disposition: form-data; name="{field}"; filename="{name}"\r\n\r\n'
        body = head.encode() + content + f"\r\n--{mark}--\r\n".encode()
        return self.ask("POST", path, body, content_type=f"multipart/form-data; boundary={mark}")

    def until_done(self, path):
        """The part of a page at a path, when no command runs for it any more."""
        end = time.monotonic() + 120
        while time.monotonic() < end:
            text = self.get(path)
            if 'class="waiting"' not in text:
                return text
            path = re.search(r'hx-get="([^"]+)"', text)[1].replace("&amp;", "&")
            time.sleep(0.05)
        raise AssertionError(f"{path} did not end: {text}")

    def run(self, name, action, **fields):
        """The result of a form."""
        status, text = self.post(f"/files/{name}/run/{action}", **fields)
        assert status == 200, text
        return self.until_done(re.search(r'hx-get="([^"]+)"', text)[1].replace("&amp;", "&"))

    def reading(self, name):
        """The reading of a file, as JSON."""
        self.until_done(f"/files/{name}/reading")
        return json.loads(self.page._shown[name].look.output)


@contextmanager
def served(folder, largest=LARGEST):
    """A client of the page of a folder."""
    sock = listening(0)
    page = Page(Project(folder), cli.main)
    port = sock.getsockname()[1]
    guard = Guard(page.application(), port, largest)
    config = uvicorn.Config(guard, log_level="critical", access_log=False, lifespan="off", ws="none")
    server = uvicorn.Server(config)
    thread = threading.Thread(target=server.run, kwargs={"sockets": [sock]}, daemon=True)
    thread.start()
    try:
        yield Client(port, guard.token, page)
    finally:
        server.should_exit = True
        thread.join(10)
        page.jobs.close()
        sock.close()


def slow_command(words):
    """Write a file slowly, as a command that does not hear a request to stop while it puts results in place."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    with Path(words[1]).open("a", encoding="utf-8") as file:
        for mark in "<>":
            file.write(words[0] + mark)
            file.flush()
            time.sleep(0.3)
    return 0
