"""The files of docker/kubernetes: against the schemas of Kubernetes, against compose-cluster.yaml, and KEDA's query on a database with jobs.

No cluster runs them here.
"""

import glob
import os
import re
import subprocess

from attack import Report, Server, head, program
from with_yaml import need

need("yaml", "kubernetes_validate")

import kubernetes_validate
import yaml

from cluster import Shared
from proxy import ROOT

DOCKER = os.path.join(ROOT, "docker")


def documents():
    for path in sorted(glob.glob(os.path.join(DOCKER, "kubernetes", "*.yaml"))):
        with open(path) as file:
            yield from yaml.safe_load_all(file)


def containers(document):
    spec = document.get("spec", {}).get("template", {}).get("spec", {})
    return spec.get("containers", [])


def main():
    report = Report("the files for Kubernetes")
    version = kubernetes_validate.latest_version()
    by_kind, of_keda = {}, []
    for document in documents():
        by_kind.setdefault(document["kind"], []).append(document)
        if document["apiVersion"].startswith("keda.sh/"):
            of_keda.append(document)
            continue
        name = f"{document['kind']} {document['metadata']['name']}"
        try:
            kubernetes_validate.validate(document, version, strict=True)
            report.expect(f"{name} is as the schema of Kubernetes {version} wants it", True)
        except kubernetes_validate.ValidationError as error:
            report.expect(f"{name} is as the schema wants it", False, f"{list(error.path)}: {error.message}")

    with open(os.path.join(DOCKER, "compose-cluster.yaml")) as file:
        compose = yaml.safe_load(file)["services"]
    [settings] = by_kind["ConfigMap"]
    # One machine has one token; a cluster has named ones.
    wanted = set(compose["server-1"]["environment"]) - {"ISOCORTEX_TOKEN_FILE"} | {"ISOCORTEX_TOKENS_FILE"}
    report.expect("the variables are those of compose-cluster.yaml", set(settings["data"]) == wanted, sorted(set(settings["data"]) ^ wanted))
    ours = [c for kind in ("StatefulSet", "Deployment") for d in by_kind[kind] for c in containers(d) if c["image"] == "isocortex"]
    commands = sorted(container["args"] for container in ours)
    in_compose = [list(x) for x in sorted({tuple(s["command"]) for s in compose.values() if s.get("image") == "isocortex"})]
    report.expect("the commands are those of compose-cluster.yaml", commands == in_compose, commands)
    for command in commands:
        known = subprocess.run([program(), *command, "--help"], capture_output=True)
        report.expect(f"the program knows `{' '.join(command)}`", known.returncode == 0)
    for container in ours:
        safe = container["securityContext"]
        hardened = safe["readOnlyRootFilesystem"] and not safe["allowPrivilegeEscalation"] and safe["capabilities"] == {"drop": ["ALL"]}
        writable = {mount["mountPath"] for mount in container["volumeMounts"] if not mount.get("readOnly")}
        report.expect(f"{container['name']} writes to /data and /tmp alone", hardened and writable == {"/data", "/tmp"}, writable)

    labels = {}
    for kind in ("StatefulSet", "Deployment"):
        for document in by_kind[kind]:
            pod = document["spec"]["template"]
            names = {port["name"] for container in containers(document) for port in container["ports"]}
            labels[pod["metadata"]["labels"]["app"]] = names
    policies = {document["spec"]["podSelector"]["matchLabels"]["app"]: document["spec"] for document in by_kind["NetworkPolicy"]}
    report.expect("there is a policy for the network of each kind of pod", set(policies) == set(labels), sorted(policies))
    for app, policy in policies.items():
        named = {port["port"] for rule in policy.get("ingress", []) for port in rule["ports"]}
        report.expect(f"the policy of {app} opens ports that the pod has", named <= labels[app], sorted(named))
        others = [peer["podSelector"]["matchLabels"].get("app") for rule in policy.get("egress", []) for peer in rule.get("to", [])]
        report.expect(f"the policy of {app} names pods that there are", set(others) <= set(labels), others)
    open_to_workers = {port["port"] for rule in policies["isocortex-worker"]["egress"] for port in rule["ports"]}
    report.expect("workers reach the database", 5432 in open_to_workers, sorted(open_to_workers))

    # What the page says to do must name what the files use.
    with open(os.path.join(ROOT, "docs", "install.md")) as file:
        page = file.read()
    with open(os.path.join(DOCKER, "Caddyfile")) as file:
        caddyfile = file.read()
    old, new = re.search(r"sed 's/([^/]+)/([^/]+)/' Caddyfile", page).groups()
    service = next(s for s in by_kind["Service"] if s["spec"].get("clusterIP") == "None")["metadata"]["name"]
    [servers] = by_kind["StatefulSet"]
    names = [f"{servers['metadata']['name']}-{number}.{service}:8640" for number in range(servers["spec"]["replicas"])]
    report.expect("Caddy's servers are the pods", old in caddyfile and new.split() == names, new)
    keys = {os.path.basename(path) for path in re.findall(r"--from-file=secrets/(\S+)", page)}
    used = {os.path.basename(value) for key, value in settings["data"].items() if key.endswith("_FILE")}
    report.expect("the secret has every file that is read", used <= keys, sorted(keys))

    [scaled] = [document for document in of_keda if document["kind"] == "ScaledObject"]
    workers = {document["metadata"]["name"] for document in by_kind["Deployment"]}
    report.expect("KEDA scales the workers", scaled["spec"]["scaleTargetRef"]["name"] in workers)
    query = scaled["spec"]["triggers"][0]["metadata"]["query"]
    with Shared() as store, Server(environment=store.environment, arguments=["--workers", "0"]) as server:
        counts = []
        for seed in range(3):
            counts.append(store.postgres.ask(query))
            server.upload(head(10.0, seed))
        counts.append(store.postgres.ask(query))
        report.expect("KEDA's query counts the jobs", counts == [[["0"]], [["1"]], [["2"]], [["3"]]], counts)
    report.end()


main()
