"""The operator's page: what is shown (state, intake), who may ask (security), what is served (web)."""
