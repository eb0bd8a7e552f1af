"""The manifests of deploy/kubernetes, as they are written and as kustomize builds them."""

import re
import shutil
import subprocess
from pathlib import Path
from typing import Any

import yaml
from service_processes import ROOT

KUBERNETES = ROOT / "deploy" / "kubernetes"
SECRET = "of this test only"
Manifest = dict[str, Any]


def written(folder: str = "base") -> list[Manifest]:
    """Return the manifests as they are written."""
    base = KUBERNETES / folder
    names = yaml.safe_load((base / "kustomization.yaml").read_text())["resources"]
    return [each for name in names for each in yaml.safe_load_all((base / name).read_text())]


def built(overlay: str, directory: Path) -> list[Manifest]:
    """Return what `kubectl kustomize` builds from an overlay, with the secrets of the example."""
    copy = shutil.copytree(KUBERNETES, directory / "kubernetes")
    for example in copy.rglob("*.env.example"):
        shutil.copy(example, example.with_suffix(""))
    kubectl = shutil.which("kubectl")
    assert kubectl is not None
    made = subprocess.run([kubectl, "kustomize", str(copy / overlay)], capture_output=True, text=True)
    assert made.returncode == 0, made.stderr
    return list(yaml.safe_load_all(made.stdout))


def pods(manifests: list[Manifest]) -> dict[str, Manifest]:
    """Return the specification of every pod, by the name of its container."""
    found = []
    for each in manifests:
        spec = each.get("spec", {})
        if each["kind"] == "DaskCluster":
            found += [spec["scheduler"]["spec"], spec["worker"]["spec"]]
        elif "template" in spec:
            found.append(spec["template"]["spec"])
    return {each["containers"][0]["name"]: each for each in found}


def services(manifests: list[Manifest], given: dict[str, str]) -> dict[str, Any]:
    """Return the containers of the manifests in the format of docker compose.

    Parameters
    ----------
    manifests
        Manifests that define the containers.
    given
        Environment variables that the operator of dask sets in its containers.
    """
    found: dict[str, Any] = {}
    for name, pod in pods(manifests).items():
        (container,) = pod["containers"]
        environment = {each["name"]: each.get("value", SECRET) for each in container.get("env", [])}
        of_operator = given if name in ("scheduler", "worker") else {}

        def expanded(word: str, known: dict[str, str] = environment | of_operator) -> str:
            return re.sub(r"\$\((\w+)\)", lambda match: known[match[1]], word)

        test = _test(container.get("readinessProbe", {}), container)
        found[name] = {
            "command": [expanded(word) for word in container["args"]],
            "environment": environment | of_operator,
            "healthcheck": {"test": test} if test else {},
        }
    return found


def _test(probe: Manifest, container: Manifest) -> list[str]:
    """Return a command that does what a probe of Kubernetes does."""
    ports = {each.get("name"): each["containerPort"] for each in container.get("ports", [])}
    if "exec" in probe:
        return ["CMD", *probe["exec"]["command"]]
    if "httpGet" in probe:
        url = f"http://127.0.0.1:{ports[probe['httpGet']['port']]}{probe['httpGet']['path']}"
        return ["CMD", "python", "-c", f"import urllib.request as r; r.urlopen({url!r}, timeout=9)"]
    if "tcpSocket" in probe:
        port = ports[probe["tcpSocket"]["port"]]
        return ["CMD", "python", "-c", f"import socket; socket.create_connection(('127.0.0.1', {port}), 9).close()"]
    return []
