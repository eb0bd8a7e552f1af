"""The promises of deploy/kubernetes; tests/integration/test_kubernetes_commands.py runs the commands."""

import re
import shutil
from pathlib import Path
from typing import Any

import kubernetes_validate
import pytest
from manifests import KUBERNETES, ROOT, Manifest, built, pods, written

MANIFESTS = written()
KUBECTL = pytest.mark.skipif(shutil.which("kubectl") is None, reason="kubectl is not installed")
RELEASES = ("1.31", "1.34")
#: A kind of the operator's, whose parts are those of Kubernetes.
OF_THE_OPERATOR = "DaskCluster"


def named(kind: str, name: str, manifests: list[Manifest] | None = None) -> Manifest:
    (found,) = (each for each in manifests or MANIFESTS if (each["kind"], each["metadata"]["name"]) == (kind, name))
    return found


def parts(manifest: Manifest) -> list[Manifest]:
    """Return a manifest as kinds of which there are schemas."""
    if manifest["kind"] != OF_THE_OPERATOR:
        return [manifest]
    spec = manifest["spec"]
    assert manifest["apiVersion"] == "kubernetes.dask.org/v1"
    assert set(spec) == {"worker", "scheduler"}
    assert set(spec["worker"]) == {"replicas", "spec"}
    assert set(spec["scheduler"]) == {"spec", "service"}
    metadata = {"name": manifest["metadata"]["name"]}
    return [
        {"apiVersion": "v1", "kind": "Pod", "metadata": metadata, "spec": spec["worker"]["spec"]},
        {"apiVersion": "v1", "kind": "Pod", "metadata": metadata, "spec": spec["scheduler"]["spec"]},
        {"apiVersion": "v1", "kind": "Service", "metadata": metadata, "spec": spec["scheduler"]["service"]},
    ]


@pytest.mark.parametrize("release", RELEASES)
def test_every_manifest_is_what_its_kind_may_be(release: str) -> None:
    for manifest in [*MANIFESTS, *_documents("first-key.yaml")]:
        for part in parts(manifest):
            kubernetes_validate.validate(part, release, strict=True)


def test_a_fault_would_be_found() -> None:
    wrong = {**named("Service", "front"), "spec": {"ports": [{"port": "http"}], "nothing": 1}}
    with pytest.raises(kubernetes_validate.ValidationError):
        kubernetes_validate.validate(wrong, RELEASES[0], strict=True)


@KUBECTL
@pytest.mark.parametrize("overlay", ["base", "bucket"])
def test_kustomize_makes_manifests_of_it(overlay: str, tmp_path: Path) -> None:
    manifests = built(overlay, tmp_path)
    for manifest in manifests:
        for part in parts(manifest):
            kubernetes_validate.validate(part, RELEASES[-1], strict=True)
        assert manifest["kind"] == "Namespace" or manifest["metadata"]["namespace"] == "gear-rattle"
    secrets = {each["metadata"]["name"] for each in manifests if each["kind"] == "Secret"}
    assert secrets == {"rattle"} | ({"bucket"} if overlay == "bucket" else set())
    kinds = {each["kind"] for each in manifests}
    assert ("PersistentVolumeClaim" in kinds) is (overlay == "base")
    for name, pod in pods(manifests).items():
        assert pod["containers"][0]["image"] in ("REGISTRY/gear-rattle:VERSION", "postgres:17")
        stores = [each for each in pod.get("volumes", []) if each["name"] in ("data", "cache")]
        assert all(("persistentVolumeClaim" in each) is (overlay == "base") for each in stores)
        from_bucket = pod["containers"][0].get("envFrom") == [{"secretRef": {"name": "bucket"}}]
        assert from_bucket is (overlay == "bucket" and name in ("front", "worker"))


def test_everything_that_is_named_is_there() -> None:
    claims = {each["metadata"]["name"] for each in MANIFESTS if each["kind"] == "PersistentVolumeClaim"}
    for pod in pods(MANIFESTS).values():
        (container,) = pod["containers"]
        volumes = {each["name"] for each in pod.get("volumes", [])} | {"database"}
        assert {each["name"] for each in container["volumeMounts"]} <= volumes
        assert {
            each["persistentVolumeClaim"]["claimName"] for each in pod["volumes"] if "persistentVolumeClaim" in each
        } <= claims
    stateful = named("StatefulSet", "postgres")
    assert [each["metadata"]["name"] for each in stateful["spec"]["volumeClaimTemplates"]] == ["database"]
    for name in ("front", "postgres"):
        selector = named("Service", name)["spec"]["selector"]
        owner = stateful if name == "postgres" else named("Deployment", "front")
        assert selector == owner["spec"]["template"]["metadata"]["labels"] == owner["spec"]["selector"]["matchLabels"]
    backend = named("Ingress", "front")["spec"]["rules"][0]["http"]["paths"][0]["backend"]["service"]
    assert backend == {"name": "front", "port": {"name": named("Service", "front")["spec"]["ports"][0]["name"]}}
    cluster = named(OF_THE_OPERATOR, "rattle")
    scheduler = cluster["spec"]["scheduler"]["service"]
    assert f"tcp://{cluster['metadata']['name']}-scheduler:{scheduler['ports'][0]['port']}" in _arguments("front")


def test_every_container_is_confined_and_limited() -> None:
    for name, pod in pods([*MANIFESTS, *_documents("first-key.yaml")]).items():
        (container,) = pod["containers"]
        assert pod["automountServiceAccountToken"] is False, name
        assert pod["securityContext"]["runAsNonRoot"] is True
        assert pod["securityContext"]["seccompProfile"] == {"type": "RuntimeDefault"}
        own = container["securityContext"]
        assert own == {
            "allowPrivilegeEscalation": False,
            "readOnlyRootFilesystem": True,
            "capabilities": {"drop": ["ALL"]},
        }
        assert "memory" in container["resources"]["limits"]
        assert {each["mountPath"] for each in container["volumeMounts"]} >= {"/tmp"}
    front = pods(MANIFESTS)["front"]["containers"][0]
    assert {"startupProbe", "livenessProbe", "readinessProbe"} <= set(front)


def test_dasks_ports_and_the_database_stay_inside() -> None:
    policies = {each["metadata"]["name"]: each["spec"] for each in MANIFESTS if each["kind"] == "NetworkPolicy"}
    assert policies["nothing"] == {"podSelector": {}, "policyTypes": ["Ingress"]}
    dask, front = {"dask.org/cluster-name": "rattle"}, {"app": "front"}
    assert policies["dask"]["podSelector"]["matchLabels"] == dask
    (rule,) = policies["dask"]["ingress"]
    assert [each["podSelector"]["matchLabels"] for each in rule["from"]] == [dask, front]
    (rule,) = policies["database"]["ingress"]
    assert rule == {"from": [{"podSelector": {"matchLabels": front}}], "ports": [{"port": 5432}]}
    (rule,) = policies["front"]["ingress"]
    assert rule["ports"] == [{"port": 8000}]
    assert named("Namespace", "gear-rattle")["metadata"]["labels"]["pod-security.kubernetes.io/enforce"] == "restricted"
    assert not any(
        each["spec"].get("type") in ("NodePort", "LoadBalancer") for each in MANIFESTS if each["kind"] == "Service"
    )
    assert named(OF_THE_OPERATOR, "rattle")["spec"]["scheduler"]["service"]["type"] == "ClusterIP"


def test_no_password_is_written_down() -> None:
    for pod in pods([*MANIFESTS, *_documents("first-key.yaml")]).values():
        for variable in pod["containers"][0].get("env", []):
            if "PASSWORD" in variable["name"]:
                assert variable["valueFrom"]["secretKeyRef"]["name"] == "rattle"
    assert "*.env" in (KUBERNETES / ".gitignore").read_text().split()
    assert not list(KUBERNETES.rglob("*.env"))


def test_the_front_asks_for_keys_and_has_the_settings_of_docker_compose() -> None:
    environment = {each["name"]: each.get("value") for each in pods(MANIFESTS)["front"]["containers"][0]["env"]}
    assert environment["RATTLE_REQUIRE_KEYS"] == environment["RATTLE_BEHIND_PROXY"] == "true"
    assert "--insecure" not in _arguments("front")
    compose = (ROOT / "docker-compose.yml").read_text()
    for name in environment:
        assert re.search(rf"\b{name}:", compose), name


def _arguments(name: str) -> list[str]:
    found: list[str] = pods(MANIFESTS)[name]["containers"][0]["args"]
    return found


def _documents(name: str) -> list[Any]:
    import yaml

    return list(yaml.safe_load_all((KUBERNETES / "base" / name).read_text()))
